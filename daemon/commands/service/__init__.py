"""The daemon itself: in the foreground, on a simulated arm, from a recording."""
