"""The live page of one arm in a browser: a separate process that reads Zenoh."""
