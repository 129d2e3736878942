"""Causes in joints and links: bearings, play, weight, a knock."""
