"""What the offline functions return: tables, their display, pages of reports."""
