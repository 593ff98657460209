"""How likely logs are under a hypothesis: a `Comparison` of a user's system, or of a response.

In: a system, its logs in blocks, parameters of constants, noise and effects. Out: a log likelihood,
gradients and forecasts. `logs` is the model over logs: its `filter` predicts readings from
`augmented`, the system with effects that act. `response` is the model behind every domain.
"""
