"""Design of the next experiment: conditions, criteria, the choice of poses."""
