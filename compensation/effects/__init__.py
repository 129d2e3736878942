"""The catalogue of causes: what can be wrong with an arm, one small file per effect."""
