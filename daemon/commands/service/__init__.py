"""Commands that run the daemon: in the foreground, on a simulated arm, from a recording."""
