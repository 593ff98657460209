"""MuJoCo models as systems: joints, actuators and sensors stand for themselves.

In: an MJCF file. Out: a `MjcfSystem`, whose rates are MuJoCo's own forward dynamics; the Python
file that `gap init --mjcf` writes; and an answer as a corrected MJCF with ranges to randomise.
"""
