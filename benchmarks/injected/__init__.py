"""Faults in flight: what can break on a gantry, and flights in simulated time in which it does.

In: a fault by name, a phase of a flight, a pilot (a package or PID alone). Out: how hard the
sufferer met a stop, what the loop noticed and when, and how the flight ended. `world.py` is a
simulated gantry whose every part can be made to fail; `catalogue.py` collects the faults, a file
for each group; `phases.py` finds the moments of a flight; `flight.py` flies one case; `table.py`
sums up many.
Nothing here changes the loop: it is `runtime.loop`'s own, and so are the bytes on the wire.
"""
