"""What the offline functions take: sessions and tables, from files or from memory."""
