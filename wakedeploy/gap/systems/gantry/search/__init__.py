"""What a gantry's model lacks: a name or an expression, how sure that is, what it closes.

In: a rig and its flights. Out: an answer, a corrected rig, the gap before and after. Thresholds and
detectability are here because they repeat the search on simulated flights. May import the generic
search, the evidence and the gantry's likelihood; never plans or reports.
"""
