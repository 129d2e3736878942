"""A MicroScribe that is not there: the maker's wire, and an arm whose factory data are known."""
