"""Numerical models of what happens around and inside a rig; no files, ports or clocks.

In: constants (`wakedeploy.rig`) and inputs held over a time step. Out: velocities, forces, motions,
readings, in SI units. May import numpy, `wakedeploy.rig` and `wakedeploy.errors`; `field_reference`
needs scipy, too, and `field` alone numba, which comes with `[train]`.
"""
