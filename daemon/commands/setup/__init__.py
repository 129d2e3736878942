"""Commands used before measuring: write and check files, find ports, help."""
