"""Causes in joints and links: bearings, backlash, weight, a knock."""
