"""The steps' artefacts as words, tables, figures and pages.

In: the artefacts of a folder. Out: sentences, HTML and pictures; no number is computed here that no
artefact has. May import everything of the gap workflow but `workflow` and `demo`.
"""
