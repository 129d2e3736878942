"""Kinds of measuring campaigns, one file each."""
