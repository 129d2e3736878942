"""Causes around the arm: its mount, its tip, the artefact and how the tip touches it."""
