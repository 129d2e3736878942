"""The inverse of the correction: joint angles that bring the real tip to a wanted position."""
