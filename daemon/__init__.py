"""The live service and the command line."""

import signal
import sys

# Before all that takes time to be imported: a reload that is asked of a daemon which has read
# nothing yet is no reason to end (SIGHUP's own effect); `armd run` sets its handler later.
if sys.argv[:1] and sys.argv[0].rpartition("/")[2] in ("armd", "-m") and "run" in sys.argv[1:3]:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
