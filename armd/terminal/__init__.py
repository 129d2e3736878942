"""Text on the terminal: command lines, suggestions, and messages beside a result."""
