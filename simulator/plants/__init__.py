"""Plants causes in a simulated arm, each by its own physics."""
