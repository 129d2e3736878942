"""Read a URDF as an arm.toml, and edit a URDF in place."""
