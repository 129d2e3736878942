"""A simulated arm, from physics to bytes on a wire."""
