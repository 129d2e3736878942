"""What is told of a history: the result, the page, the mended calibration, the next check."""
