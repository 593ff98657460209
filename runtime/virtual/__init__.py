"""The virtual gantry: a plant process behind a pseudo-terminal and a Unix socket.

In: a rig file (the plant's truth), a seed. Out: the bytes of a real UNO, and range samples. May
import the rest of `runtime` and the ground, `wakedeploy.physics` included (but not its 2D field).
"""
