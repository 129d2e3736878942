"""What other programs call a servo's zero: LeRobot, phosphobot."""
