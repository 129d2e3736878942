"""Whether sessions may be identified from: enough readings, no mistake in them, none odd."""
