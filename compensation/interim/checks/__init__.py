"""One check: what it says of the arm, and how it is kept."""
