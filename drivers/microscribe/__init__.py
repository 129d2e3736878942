"""MicroScribe digitizers (3D, 3DX, 3DL, G, G2) on a serial line."""
