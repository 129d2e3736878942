"""Interim checks of an arm whose joints nobody reads: tables of points over time."""
