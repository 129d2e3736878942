"""The same, compiled: terms as a program, chains, factors, points and their covariance."""
