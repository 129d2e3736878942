"""What happens to the arm while it is used: its mount, its tip."""
