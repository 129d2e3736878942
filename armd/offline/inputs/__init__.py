"""Inputs of the offline functions: sessions and tables, from files or from memory."""
