"""Files read and written: checked, whole or not at all, one form of words for what is wrong."""
