"""How far long work has come, told to whoever waits for it."""

from collections.abc import Callable

TellStep = Callable[[str], None]  # what is being done
TellShare = Callable[[str, float], None]  # and the share that is done, 0 … 1
