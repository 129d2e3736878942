"""Errors of encoders."""
