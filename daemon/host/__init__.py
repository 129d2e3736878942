"""The machine under the daemon: systemd, journal, priorities, processors, metrics."""
