"""What the simulated arm really is: geometry, heat, statics and imperfections, by physics."""
