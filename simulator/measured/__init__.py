"""Sessions without a wire: artefacts, their placements, postures, readings."""
