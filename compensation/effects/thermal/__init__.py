"""Causes that depend on temperature, and faults of the sensors that measure it."""
