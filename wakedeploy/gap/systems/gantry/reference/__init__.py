"""Reference flights: ordinary flights show what the rig file does not state.

In: a rig file and flights with nothing new in them. Out: how much differs from flight to flight,
which flight is unlike the others, and a rig file with these flights' jet axis, wake map and
constants. It imports what `wakedeploy.gap.systems.gantry.search` does.
"""
