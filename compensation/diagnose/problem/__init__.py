"""One linear problem of the sessions around a model, as values for the diagnosis."""
