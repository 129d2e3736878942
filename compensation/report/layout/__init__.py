"""The layout of all reports: the parts of a page, drawings, units and the head."""
