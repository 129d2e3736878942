"""The live service and the command line."""

import signal
import sys

# This runs before the slow imports: SIGHUP asks for a reload, and its default action would end a
# daemon that has not read its configuration yet. `armd run` sets its handler later.
if sys.argv[:1] and sys.argv[0].rpartition("/")[2] in ("armd", "-m") and "run" in sys.argv[1:3]:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
