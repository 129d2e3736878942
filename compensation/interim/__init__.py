"""An arm over time: short checks tell when it changed and why, and what was measured since is
corrected again."""
