"""Read servo zeros from the calibration files of LeRobot and phosphobot."""
