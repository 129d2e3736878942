"""How a page of a report looks, whatever it reports: its parts, drawings, units and head."""
