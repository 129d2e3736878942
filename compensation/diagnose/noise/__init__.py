"""The noise of rests in a diagnosis: variances by restricted maximum likelihood."""
