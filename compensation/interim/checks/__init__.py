"""One interim check: its reduction to statistics, and how it is kept in a history."""
