"""The twin: a simulated arm with the errors of a measured arm's calibration, terms included."""
