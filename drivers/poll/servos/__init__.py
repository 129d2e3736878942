"""The servos of a line: their identity, their use, and their faults."""
