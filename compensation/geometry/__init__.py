"""An arm's geometry for other software: at one temperature, without terms, as tables."""
