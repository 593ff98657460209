"""What is missing: where it shows, its name or expression, how sure that is, what it closes.

In: a system's model and episodes. Out: places, an answer, a corrected rig, the gap before and
after. Thresholds and detectability lie here, since they repeat the search on simulated flights. May
import the systems and the evidence; never plans or reports.
"""
