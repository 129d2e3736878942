"""What is kept in files: recordings, sessions, and the measurements and tips of an arm."""
