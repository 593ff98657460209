"""Domains: where the recordings come from, simulated here or imported from public data.

In: a rig and a seed, or a folder of recordings in its original layout. Out: an `EpisodeSet`.
May import the ground and `runtime` (the gantry's episodes fly the same controller), never
`trainers`, `export` or `torch`.
"""
