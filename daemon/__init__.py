"""The live service and the command line."""
