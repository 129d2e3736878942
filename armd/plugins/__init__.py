"""Drivers, commands and causes that other packages provide, found by their entry points."""
