"""Results of the offline functions: tables, their display, pages of reports."""
