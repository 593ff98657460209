"""Rig files: read, checked against the library of effects, and updated.

In: `rig.toml`. Out: a `Rig` (`wakedeploy.core.rig`). This stands above the physics, because a rig
file lists effects, whose names, units and bounds are the library's, and the physics takes the
numbers of a `Rig`. May import `wakedeploy.core` and `wakedeploy.physics`.
"""
