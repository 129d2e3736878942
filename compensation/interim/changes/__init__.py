"""The likeliest changes of an arm and their dates: steps and growths, several one after another."""
