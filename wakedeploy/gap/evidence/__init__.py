"""What data say about hypotheses, whatever the system: fits, held-out gains, separation, whiteness.

In: a `Model` (`inference`), episodes and hypotheses. Out: fits, gains in nats, intervals. Knows
nothing of gantries. May import the ground, numpy and scipy; of the gap workflow only `rules` and
`progress`.
"""
