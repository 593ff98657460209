"""The eight predictors and how they are trained.

In: an EpisodeSet (`wakedeploy.core.episodes`). Out: run folders with safetensors and JSON
(`training/runs.py`), read as `TrainedRun` (`trained_run.py`). `architectures` has a file for each,
`build` finds them by name, `training` fits and scores, `tuning` searches hyper-parameters,
`inspection` looks at what was trained, `trackers` report to others. May import torch, numpy,
safetensors (optuna in `tuning` alone) and `wakedeploy.core`; never `export`, `runtime`, the domains
or the command line.
"""
