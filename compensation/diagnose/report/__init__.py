"""The report of a diagnosis: to a person, to a program, and what to do next."""
