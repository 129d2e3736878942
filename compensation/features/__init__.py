"""Geometric features through measured points: fitted by least squares, and related."""
