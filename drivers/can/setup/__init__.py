"""Nodes set up by SDO, one after the other, beside the receive loop."""
