"""What a trained predictor does: where it looks, how it starts and flies, how its fit went.

In: a run or a Predictor, and episodes. Out: arrays and pictures. May import `trainers.trained_run`,
`trainers.training` and below.
"""
