"""What a model leaves, beside what it would leave if it were true: drawn and refitted data sets."""
