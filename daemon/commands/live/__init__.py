"""Commands that a running daemon feeds, or that ask something of it."""
