"""Where a guided measurement stands by its log, what that tells already, and what is next."""
