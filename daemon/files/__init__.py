"""Files that the daemon and its commands write: recordings, sessions, measurements, tips."""
