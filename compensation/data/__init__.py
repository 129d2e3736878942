"""What people measure: sessions and readings, their formats, and their correction offline."""
