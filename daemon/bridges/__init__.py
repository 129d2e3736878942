"""Separate processes that read the daemon over Zenoh and serve a host's protocol."""
