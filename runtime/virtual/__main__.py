"""`python -m runtime.virtual`: the plant process; see `runtime.virtual.process` for starting it."""

import signal

from runtime.virtual.server import main

signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the run, which then ends this process
main()
