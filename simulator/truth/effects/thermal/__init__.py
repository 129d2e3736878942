"""Effects of temperature on links, discs and housings."""
