"""The diagnosis: causes of the residuals of a model, and the gain of correcting them."""
