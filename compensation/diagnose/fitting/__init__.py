"""The fit of the model under test with the findings so far: rests, noise, nuisance."""
