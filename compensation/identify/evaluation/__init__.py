"""Evaluate a model on sessions: residuals and lengths; no constant of the arm is fitted."""
