"""Reads and writes tables of readings in pieces, CSV or Parquet."""
