"""What the loop stands on at the rig: wire, range sensor, clock, recorder, systemd.

In: bytes, samples, deadlines. Out: the same, checked and timed. May import the ground and pyserial;
never the loop.
"""
