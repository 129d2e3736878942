"""Tables of other programs, read by their own headers and names; every assumption is reported."""
