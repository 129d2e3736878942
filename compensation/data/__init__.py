"""Measured data: sessions and readings, their formats, and their correction offline."""
