"""The systems whose simulation is compared with measurements: a baseline and its effects for each.

In: public recordings in their original layout, flights of a gantry, logs of a user's system, or a
small simulation. Out: a `Comparison` for `wakedeploy.gap.search`. `own_system` has the base class
of users' own files, `system` what such a class states; beside them is what reads, checks, replays
and corrects one. `likelihood` says how likely logs are, `kinds` what may be missing, `answers` what
a search found in words and files, `planning` what logs can tell. `mjcf` makes a MuJoCo model such a
system; `domains` has those with recordings of others, and `gantry` the rig.
"""
