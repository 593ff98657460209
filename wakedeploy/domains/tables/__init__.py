"""Logs of any system: columns of files that other programs wrote, as recordings and as a set.

In: files, and a `columns.toml` that says what their columns mean. Out: `Recording`s for the gap
workflow (`reading.py`) and an `EpisodeSet` for training (`training.py`). `formats/` has a module
for each kind of file, which imports its library only when such a file is read.
"""
