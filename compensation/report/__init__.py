"""Self-contained HTML reports: one file, opens offline, axes carry units."""
