"""The eight predictors and how they are trained.

In: an EpisodeSet (`wakedeploy.episodes`). Out: run folders with safetensors and JSON (`runs.py`).
One architecture, one file; `build.py` lists them, `fit.py` trains, `score.py` scores, `tuning/`
searches hyper-parameters. May import torch, numpy, safetensors (optuna in `tuning/` alone) and the
ground (`wakedeploy.episodes` and what it needs); never `export`, `runtime`, the domains or the
command line.
"""
