"""A referee for the gap workflow: gantries whose form differs from the model's.

In: families of jet, friction, motor, sensor and noise, and how far the jet's form is off. Out:
flights of such gantries, what the workflow answers to them, and a dose curve. `profiles`,
`equations` and `plant` import nothing of the project: the model cannot have been fitted to them.
"""
