"""The simulated arm as CANopen nodes, on several kinds of CAN wires."""
