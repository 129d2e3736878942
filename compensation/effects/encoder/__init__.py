"""Causes in an encoder: its disc, its reading, its clock."""
