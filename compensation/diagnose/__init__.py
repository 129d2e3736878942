"""From residuals to causes: what a model gets wrong, why, and the gain of mending it."""
