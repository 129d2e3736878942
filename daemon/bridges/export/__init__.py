"""Measurements as files that other programs open."""
