"""Re-correction of measurements, and its page for the quality file."""
