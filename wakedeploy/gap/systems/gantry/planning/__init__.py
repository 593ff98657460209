"""Before flights: what they could tell apart, which manoeuvre splits a class, what a sensor adds.

In: a rig and, if there are any, flights. Out: plans and predicted rates. May import the search and
what the search may import; never reports.
"""
