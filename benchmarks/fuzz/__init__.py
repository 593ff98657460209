"""Damaged and forged files by the hundred thousand, read by what the commands read them with.

In: kinds of files, each with sound ones, a reader and ways to damage them (`kinds.py`). Out: how
many were read, how many refused in a sentence, and every one that did anything else, with what
makes it again: kind, seed and number. May import everything.
"""
