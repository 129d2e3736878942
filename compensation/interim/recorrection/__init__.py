"""Measurements corrected again, and the page of it for the quality file."""
