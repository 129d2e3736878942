"""Changes of the arm in use: its mount, its tip."""
