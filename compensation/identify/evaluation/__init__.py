"""What a model leaves of sessions, in residuals and lengths: nothing of the arm is fitted."""
