"""Checks before identification: enough readings, no mistakes, no inconsistent session."""
