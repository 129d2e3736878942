"""What comes before measuring: files to start from and what is wrong in them, ports, help."""
