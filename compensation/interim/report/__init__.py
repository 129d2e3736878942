"""The report of a history: result, page, corrected calibration, next check."""
