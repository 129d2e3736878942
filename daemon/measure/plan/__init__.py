"""Plans of guided measurements: stations in the order in which to measure them."""
