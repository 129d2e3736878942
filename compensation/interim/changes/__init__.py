"""Which change, and when: the likeliest, steps and growths, several one after another."""
