"""The report of a diagnosis: for a person, for a program, and the next experiment."""
