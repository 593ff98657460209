"""Numerical models of what happens around and inside a rig; no files, ports or clocks.

In: constants (`wakedeploy.core.rig`) and inputs held over a time step. Out: velocities, forces,
motions, readings, in SI units. May import numpy and `wakedeploy.core`; `field_reference` needs
scipy, too. `field`, `series`, `kalman` and `friction` need numba, which comes with `[train]`.
"""
