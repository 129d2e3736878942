"""Joints, links and styluses that are displaced, or bend."""
