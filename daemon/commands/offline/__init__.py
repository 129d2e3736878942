"""Commands that make measured data into models, verdicts and corrected points."""
