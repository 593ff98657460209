"""Small predictors of wake forces: simulated, trained, deployed, questioned when they are wrong.

The ground that all parts share lies in `core`; `rig` reads rig files, `physics` has the models,
`domains` the places where episodes come from, `gap` compares simulation and measurement, `study`
and `sweep` run many trainings, `deploy` copies packages to the rig, `cli` is the command line.
`trainers`, `export` and `runtime` stand beside this package.
"""

from wakedeploy.core.version import VERSION as __version__

__all__ = ["__version__"]
