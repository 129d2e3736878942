"""Configuration of nodes by SDO, one after the other, beside the receive loop."""
