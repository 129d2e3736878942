"""An arm over time: what was measured is corrected again by what was learnt since."""
