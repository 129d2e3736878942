"""The scores of candidates on the residual: projection, evidence, significance, likeness."""
