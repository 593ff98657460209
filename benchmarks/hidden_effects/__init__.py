"""The benchmark of the gap workflow: hidden effects on two plants, judged by rules fixed before.

In: a seed and a size. Out: one line per case, and the tables and figure made from them. Stands on
the gap workflow, the domains and the runtime; the second plant imports nothing of the project.
"""
