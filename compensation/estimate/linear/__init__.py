"""Linear least squares: named blocks of columns with priors, and what is known of them."""
