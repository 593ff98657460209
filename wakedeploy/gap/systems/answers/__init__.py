"""What a search found in a user's system: as sentences, advice, the next commands, and a folder.

In: a result of `wakedeploy.gap.search` and its model. Out: lines for a terminal or a page, and the
files that one step leaves for the next.
"""
