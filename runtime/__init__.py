"""From a package to PWM pulses: the 32 Hz control loop that runs on the Pi.

In: a package (`wakedeploy.package`), a rig file, a serial port and a range sensor. Out: commands
to the UNO and a run log. May import the ground of `wakedeploy` without `physics.field`; never
torch, onnx, optuna, numba, pandas, matplotlib or another package of this project.
"""
