"""The commands of `armd`, one module each."""
