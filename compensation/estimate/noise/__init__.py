"""The noise of readings, errors that copies of a posture share, and the treatment of outliers."""
