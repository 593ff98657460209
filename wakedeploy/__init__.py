"""Small predictors of wake forces: simulated, trained, deployed, questioned when they are wrong.

This package holds the command line (`cli`) and what all parts share: recorded series (`episodes`),
gantry flights (`runlog`), a gantry's constants (`rig`), the contract of an exported model
(`package`), the physics and the domains. `trainers`, `export` and `runtime` stand beside it.
"""

__version__ = "0.1.0"
