"""The report of `armd calibrate`: its page, drawings and tables."""
