"""What an arm is: its parameters, terms, calibration, kinematics, gravity and state."""
