"""The inverse of the correction: the angles that bring the real tip where it is wanted."""
