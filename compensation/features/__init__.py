"""Geometric features fitted to measured points by least squares, and relations between them."""
