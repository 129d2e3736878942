"""Who the servos of a line are, what each is for, and what keeps them from being believed."""
