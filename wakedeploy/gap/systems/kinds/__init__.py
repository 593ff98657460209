"""Kinds of effect, each written once; `library` offers each at the ports where it makes sense.

`kind` has what they share, `inputs` and `forces` the kinds for ports of these roles, `sensors`
those for outputs and for constants. A kind vanishes where its sizes are 0; its other parameters are
shapes.
"""
