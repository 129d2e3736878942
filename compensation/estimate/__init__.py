"""One estimation problem: observations, placements, noise, elimination, solution."""
