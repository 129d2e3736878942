"""What stands between this machine and an arm, and the command that mends it. Changes nothing."""
