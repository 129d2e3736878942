"""Find the obstacles between this machine and an arm, and their remedies, changing nothing."""
