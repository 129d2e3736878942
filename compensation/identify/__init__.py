"""Identify constants and coefficients from sessions: least squares, rank, uncertainty."""
