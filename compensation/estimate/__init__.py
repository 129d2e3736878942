"""One estimation problem: observations, placements, noise, `LinearModel`."""
