"""Interim checks of an arm whose joint angles are not available: tables of points over time."""
