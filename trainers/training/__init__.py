"""How a predictor is trained: tape, fit, loss, run folder, score.

In: an EpisodeSet, an architecture's name and settings. Out: a run folder. May import the
architectures and what they build on, and `trainers.trained_run`, which training ends with.
"""
