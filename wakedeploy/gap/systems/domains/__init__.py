"""Baselines with recordings of others, or with a simulation of their own: a file each.

In: recordings in their original layout. Out: a `Comparison` and what the domain alone adds. A
module is found by its `GAP_DOMAIN`, one of another package by an entry point of the group
`wakedeploy.gap_domains`; `domain` says what such a constant has. Loads nothing heavy: the command
line lists these names.
"""

from wakedeploy.core.discovery import Kind

KIND = Kind("gap domain", "wakedeploy.gap_domains", "wakedeploy.gap.systems.domains", "GAP_DOMAIN")
