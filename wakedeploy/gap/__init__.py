"""Where simulation and measurement disagree: find the place, name the effect, add it, show.

In: a rig file and run logs of flights. Out: places, names with intervals, a corrected rig file, the
gap before and after, a report. `workflow` orders the steps, `folder` has what they left, `systems`
say how likely data are under a hypothesis, `evidence` judges hypotheses whatever the system,
`search` decides, `planning` looks ahead, `report` tells. May import everything of the project
except `wakedeploy.cli`.
"""
