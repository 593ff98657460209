"""What a system's model lacks, whatever the system: where it shows, and which effect explains it.

In: a model and a fit of it. Out: places, a ranking, what is named and how much that removes. May
import the evidence; never a system, plans or reports.
"""
