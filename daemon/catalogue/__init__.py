"""Arms that people own: nominal geometry, one arm.toml each, and how armd reads them."""
