"""Drivers of servos polled on one half-duplex line: two pure codecs, and one engine for both."""
