"""Thermal models to choose among, and which of them the readings bear."""
