"""Joints, links and styluses that are not where they should be, or give way."""
