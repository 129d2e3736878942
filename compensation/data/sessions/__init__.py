"""A session: a folder of measured data; its format and columns, read strictly, written whole."""
