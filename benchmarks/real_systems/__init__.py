"""The gap workflow on systems that others built and recorded.

In: recordings, a textbook system of each in `examples/systems/`, and what the literature names that
it lacks, written down before any run. Out: what was named, and whether that was right. Nothing of
the workflow is set for a recording.
"""
