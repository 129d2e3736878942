"""Drivers, commands and causes that other packages bring, found by their entry points."""
