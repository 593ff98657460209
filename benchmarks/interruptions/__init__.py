"""What is left of a command that is killed, interrupted, out of disk, or started twice at once.

    python -m benchmarks.interruptions --kills 200 --json docs/records/interruptions.json

In: nothing but the commands themselves; `cases` lists them. Out: a record with a row for each
command and each way to disturb it. The moments are drawn by seed: half of them at a time, half at
the n-th time that a file is opened, renamed or removed. A full disk is a small one of its own,
which only root may mount.
"""
