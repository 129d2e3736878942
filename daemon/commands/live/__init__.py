"""Commands that read a running daemon, or ask it to do something."""
