"""Bayesian search of hyper-parameters under the parameter budget; Optuna lives here.

In: an EpisodeSet, an architecture and its dimensions. Out: a study that any number of processes
share and that goes on where it was stopped, and what it found as TOML, CSV and figures. `space.py`
says what is searched, `trial.py` trains one point, `workers.py` keeps trials running, `report.py`
reports. May import the rest of `trainers` and the ground; what a step costs is measured by a
function that is handed in, since packages are made above (`export`).
"""
