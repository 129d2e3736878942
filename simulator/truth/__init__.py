"""The true simulated arm: geometry, heat, statics and imperfections, by physics."""
