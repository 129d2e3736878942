"""Thermal models to choose from, and the choice that the readings support."""
