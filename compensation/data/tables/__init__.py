"""Tables of readings in pieces, CSV or Parquet, read and written."""
