"""What the sessions are to the diagnosis: one linear problem around a model, as values."""
