"""Causes around the arm: its mount, tip and artefact, and how it is held to it."""
