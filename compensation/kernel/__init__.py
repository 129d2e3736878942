"""The compiled model: terms as a program, chains, factors, points and their covariance."""
