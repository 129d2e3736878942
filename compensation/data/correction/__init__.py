"""Readings in, corrected points out, piece by piece."""
