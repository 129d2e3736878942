"""The model of an arm: parameters, terms, calibration, kinematics, gravity and state."""
