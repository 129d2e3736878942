"""What leaves the daemon and what is asked of it, over Zenoh."""
