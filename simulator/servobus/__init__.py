"""Simulated servos: both half-duplex protocols on a pty, and a printed arm of them."""
