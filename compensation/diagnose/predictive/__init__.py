"""Residuals of a model, compared with those it would leave if it were true (predictive check)."""
