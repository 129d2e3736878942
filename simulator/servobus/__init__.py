"""Servos that are not there: both half-duplex protocols on a pty, and a printed arm of them."""
