"""Where simulation and measurement disagree: find the place, name the effect, add it, show.

In: a rig file and run logs of flights, or a user's system and its logs. Out: places, names with
intervals, a corrected rig file or system, the gap before and after, a report. `workflow` orders the
steps, `folder` has what they left, `systems` say how likely data are under a hypothesis and which
input or flight would say more, `evidence` judges hypotheses whatever the system, `search` decides,
`report` writes. May import everything of the project except `wakedeploy.cli` and `wakedeploy.api`.
"""
