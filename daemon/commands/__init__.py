"""The commands of `armd`, one module each, in rooms; here what several of them share."""
