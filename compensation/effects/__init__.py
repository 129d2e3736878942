"""The catalogue of causes that may make an arm err, one small file per effect."""
