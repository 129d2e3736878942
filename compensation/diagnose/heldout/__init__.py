"""The worth of findings on readings that were not used in the search."""
