"""What servos say: the packets of both makers, their registers, and no line."""
