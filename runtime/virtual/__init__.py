"""The virtual gantry: a plant process behind a pseudo-terminal and a Unix socket.

In: a rig file (the plant's truth), a seed. Out: the bytes of a real UNO, and range samples. The UNO
is a model of it (`mcu_port`), or its compiled sketch on a simulated chip (`firmware_port`). May
import the rest of `runtime` and the ground, `wakedeploy.physics` included (but not its 2D field).
"""
