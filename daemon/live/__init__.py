"""From sample to point while an arm is connected."""
