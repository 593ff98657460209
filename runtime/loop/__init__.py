"""One tick: read, estimate, predict, supervise, control, write, record.

In: range samples, the board's answers, a predictor's forces. Out: pulses and rows. The steps are
pure arithmetic; clock, link and range source are given. May import `runtime.io`,
`runtime.reference` and the ground.
"""
