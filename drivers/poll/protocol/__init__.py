"""The packets of both servo makers, and their registers; nothing of the line."""
