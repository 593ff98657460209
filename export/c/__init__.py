"""From a package to one file of plain C99, and the gate that it passes before it is written.

In: a package's graph and manifest. Out: a folder with source, header, self-test and a page, or
CheckFailed and no folder. May import runtime, which compiles and steps it, and the ground.
"""
