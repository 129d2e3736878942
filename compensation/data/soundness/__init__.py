"""Faults of readings that are independent of the arm: in temperatures, turns and times."""
