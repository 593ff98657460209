"""The architectures, one file each: hyper-parameters with their dimensions, and a core.

In: the sizes of a domain and hyper-parameters. Out: a `WakeModel` (`trainers.model`). May import
`trainers.model`, `memory`, `dimensions` and `recurrences`, and each other where one builds on
another.
"""
