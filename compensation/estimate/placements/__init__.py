"""Poses of the artefact and free targets, fitted or eliminated."""
