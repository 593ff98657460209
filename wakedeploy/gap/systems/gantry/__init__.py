"""The gantry as a system of the gap workflow: its run logs, its forces, how likely its flights are.

In: run logs and a rig. Out: a model that `wakedeploy.gap.evidence` fits. May import the evidence,
the physics, the runtime's replay and what stands below them; never the search, plans or reports.
"""
