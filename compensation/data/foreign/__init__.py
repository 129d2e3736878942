"""Tables of other programs, read by what they say of themselves, and every assumption reported."""
