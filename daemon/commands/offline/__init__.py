"""Commands that turn measured data into models, verdicts and corrected points."""
