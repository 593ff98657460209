"""A rig's model as files for elsewhere: a Python module that stands alone, and MATLAB.

In: a rig. Out: text. May import the physics and the ground.
"""
