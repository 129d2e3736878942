"""Processes of their own, fed by Zenoh, each of which speaks some host's protocol."""
