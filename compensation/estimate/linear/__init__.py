"""Linear least squares: named blocks of columns with priors, solutions and their covariance."""
