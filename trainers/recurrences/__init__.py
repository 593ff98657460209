"""Recurrences over whole sequences, computed at once, with their gradients.

In: tensors. Out: what a core would compute step by step. May import torch and numba alone.
"""
