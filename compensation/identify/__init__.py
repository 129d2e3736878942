"""From measured sessions to constants and coefficients: least squares, rank, uncertainty."""
