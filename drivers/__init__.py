"""Drivers: turn bytes on a wire into samples, and a device's clock into host time."""
