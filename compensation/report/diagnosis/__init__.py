"""The report of `armd diagnose`: its page, one finding, and their drawings."""
