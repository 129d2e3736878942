"""How noisy a reading is, what copies of a posture share, and what of readings far off is done."""
