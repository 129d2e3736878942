"""Convert samples to points while an arm is connected."""
