"""The host of the daemon: systemd, journal, priorities, processors, metrics."""
