"""Sessions without a wire: artefacts, where they stand, the poses that reach them, the readings."""
