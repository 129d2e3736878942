"""The search for the causes that the readings prefer, one after another."""
