"""Wire bytes to samples: transports, codecs, one cycle at a time, device clock to host clock."""
