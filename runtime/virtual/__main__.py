"""`python -m runtime.virtual`: the plant process; see `runtime.virtual.process` for starting it."""

import signal

from runtime.io.realtime import become_ordinary
from runtime.virtual.server import main

signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the run, which then ends this process
become_ordinary()  # a run that is --realtime already, as a pair's second one, would hand that on
main()
