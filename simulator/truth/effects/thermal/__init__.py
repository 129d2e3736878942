"""What warmth does to links, discs and housings."""
