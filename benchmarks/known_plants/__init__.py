"""The gap workflow on small plants simulated here, of which it is known what the model lacks.

In: six plants, integrated in fine steps by code of their own, with an effect hidden or none, noise
in force, coloured noise at the sensor, and constants a few percent off. Out: how often the answer
is right, wrong, unknown or none. The recordings of `real_systems` are others, and kept for a last
look.
"""
