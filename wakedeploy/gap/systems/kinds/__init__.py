"""Kinds of effect, each written once; `library` offers each at the ports where it makes sense.

`kind` has what they share, `inputs`, `forces`, `outputs` and `constants` the kinds by the role of
their port. A kind vanishes where its sizes are 0; its other parameters are shapes.
"""
