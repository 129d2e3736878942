"""Hobby and research arms: one arm.toml each with nominal geometry, and code to read them."""
