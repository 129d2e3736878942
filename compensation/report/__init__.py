"""Self-contained HTML reports: each is one file, opens offline, and its axes carry units."""
