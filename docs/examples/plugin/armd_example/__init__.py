"""A driver, a command and a cause for armd."""
