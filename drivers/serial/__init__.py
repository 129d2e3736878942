"""armd's own serial wire: codec, decoder, device clock, port."""
