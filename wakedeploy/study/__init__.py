"""The paper's tables and figures, made again and extended, each by one command.

In: episode sets, simulated or imported, and what is trained on them. Out: one folder per study with
tables (CSV, JSON), figures (PNG, PDF) and a page that shows them in order. May import everything
but the command line.
"""
