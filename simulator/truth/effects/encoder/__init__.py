"""What an encoder counts beside the angle."""
