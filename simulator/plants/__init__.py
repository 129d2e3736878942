"""Planting causes in a simulated arm: each by physics of its own."""
