"""An arm that is not there: physics to wire bytes."""
