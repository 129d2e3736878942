"""Causes that go with temperature, and the sensors that read it."""
