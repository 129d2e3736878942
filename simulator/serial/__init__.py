"""The simulated arm on armd's own serial wire."""
