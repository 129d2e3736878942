"""The daemon's published data and its answers to queries, over Zenoh."""
