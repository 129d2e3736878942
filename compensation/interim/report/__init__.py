"""The report of a history: result, page, repaired calibration, next check."""
