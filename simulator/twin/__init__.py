"""The twin: a simulated arm that errs as a calibration of a measured arm says, terms included."""
