"""From a package to PWM pulses: the 32 Hz control loop that runs on the Pi.

In: a package (`wakedeploy.core.package`), a rig file, a serial port and a range sensor. Out:
commands to the UNO and a run log. `loop` has the tick, `io` what it stands on, `virtual` the gantry
as a process, `calibration` a procedure per constant; the files beside them make a whole run. May
import `wakedeploy.core`, `rig` and `physics` (without its modules that need numba); never torch,
onnx, optuna, numba, pandas, matplotlib or another package of this project.
"""
