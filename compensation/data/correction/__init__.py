"""The correction of tables of readings to tables of points, piece by piece."""
