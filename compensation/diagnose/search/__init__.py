"""The search for what the readings prefer, one cause after another."""
