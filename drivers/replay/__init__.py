"""Recordings, and the driver that plays them back."""
