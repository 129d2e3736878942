"""The report of `armd verify`: its page and drawings."""
