"""The likelihood of all checks with a change and without one, and the detection of bad checks."""
