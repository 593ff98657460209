"""Reference flights: ordinary flights tell what the rig file does not state.

In: a rig file and flights with nothing new in them. Out: how much differs from flight to flight,
which flight is unlike the others, and a rig file with the jet's axis, the wake's map, and constants
as these flights have them. It imports what `wakedeploy.gap.systems.gantry.search` does.
"""
