"""Parts of reference pages, each made of what the code itself says; `markdown()` returns its text.

In: the command line, the models of rig file and package, the tables of columns and faults.
Out: Markdown, as a page would have it.
"""
