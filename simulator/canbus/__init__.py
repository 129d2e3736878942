"""The simulated arm as CANopen nodes, over whatever carries CAN frames here."""
