"""A predictor exported to C: read its folder, compile it once, step it, prove it again.

In: a folder that `wakedeploy export --c` wrote, and a C compiler. Out: a predictor of the same
interface as a package's, which needs no onnxruntime. A folder is a program of whoever wrote it: the
compiler and this machine do what it says, so it is only as trustworthy as its author.
"""
