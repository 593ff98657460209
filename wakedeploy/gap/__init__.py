"""Where simulation and measurement disagree: find the place, name the effect, add it, show.

In: a rig file and run logs of flights. Out: places, names with intervals, a corrected rig file, the
gap before and after, a report. `inference` knows nothing of gantries and serves every domain;
`flight` and `gantry` say how likely a flight is under a hypothesis. May import everything of the
project except `wakedeploy.cli`.
"""
