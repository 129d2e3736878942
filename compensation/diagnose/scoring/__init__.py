"""What the residual wants of the candidates: projection, evidence, significance, likeness."""
