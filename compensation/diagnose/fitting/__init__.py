"""The model under test with the findings so far, fitted: rests, noise, nuisance."""
