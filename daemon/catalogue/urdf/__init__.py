"""A URDF: read as an arm.toml, and edited in place."""
