"""Export measurements to files that other programs can open."""
