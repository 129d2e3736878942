"""Types of functions that report the progress of long work."""

from collections.abc import Callable

TellStep = Callable[[str], None]  # what is being done
TellShare = Callable[[str, float], None]  # and the share that is done, 0 … 1
