"""A simulated MicroScribe: the maker's wire, and an arm with known factory data."""
