"""The ground: what every other part reads and writes, and in which words it fails.

In: files, recorded series, run logs, exported models. Out: the same as checked types. Each kind of
file that several parts share is read and written by one module here. May import numpy, pydantic and
what reads files, and within functions matplotlib and jinja2; nothing of the project outside this
folder: no physics, no torch.
"""
