"""The gantry as a system of the gap workflow: its run logs, its forces, how likely its flights are.

In: run logs and a rig. Out: a model that `wakedeploy.gap.evidence` fits; in `search` what is named,
in `planning` what to fly next, in `workflow` the four steps. May import the evidence, `gap.search`,
the physics, the runtime and what stands below them; `workflow` alone imports `gap.report`, too.
"""
