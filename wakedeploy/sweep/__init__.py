"""Sweeps: architectures × sets × seeds × settings, and the simulations that they train on.

In: a plan and an executor, this machine's processes or a dask cluster. Out: a folder with one row
per finished job (results.jsonl as they finish, results.csv at the end), trained runs and generated
sets. May import everything but the command line; `cluster.py` alone imports dask.
"""
