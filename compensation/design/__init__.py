"""The next experiment: conditions, criteria, the choice of poses."""
