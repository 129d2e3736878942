"""The arm in time, on any wire: its motion, heat, encoders, sensors and faults."""
