"""Reading and writing of files: checked, complete or not at all, with uniform error messages."""
