"""The state of a guided measurement from its log: progress, estimates, the next station."""
