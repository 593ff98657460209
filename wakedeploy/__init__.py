"""Small predictors of wake forces: simulated, trained, deployed, questioned when they are wrong.

`import wakedeploy as wd` is the interface for scripts and notebooks; the command line is thin over
the same functions. A name is loaded when it is first used, so that `import wakedeploy` and
`wakedeploy --help` load no library. `__init__.pyi` tells editors and type checkers the same names.
"""

import importlib
import os

from wakedeploy.core.version import VERSION as __version__

# Nobody who predicts has asked to inform onnxruntime's makers of it: it would store reports on disk
# and send them, by a thread of its own, also in the midst of a flight.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

# Where each public name comes from, in the order of a person's work.
_FROM = {
    "Rig": "wakedeploy.core.rig",
    "default_rig": "wakedeploy.rig.file",
    "read_rig": "wakedeploy.rig.file",
    "with_effect": "wakedeploy.rig.file",
    "make_set": "wakedeploy.api.sets",
    "import_set": "wakedeploy.api.sets",
    "import_table": "wakedeploy.api.logs",
    "guess_columns": "wakedeploy.api.logs",
    "read_log": "wakedeploy.api.logs",
    "Recording": "wakedeploy.core.recording",
    "EpisodeSet": "wakedeploy.core.episodes",
    "Episode": "wakedeploy.core.episodes",
    "Channel": "wakedeploy.core.episodes",
    "train": "wakedeploy.api.training",
    "Runs": "wakedeploy.api.training",
    "evaluate": "wakedeploy.api.evaluation",
    "Scores": "wakedeploy.api.scores",
    "tune": "wakedeploy.api.tuning",
    "Tuned": "wakedeploy.api.tuning",
    "export": "wakedeploy.api.predictors",
    "load": "wakedeploy.api.predictors",
    "Predictor": "wakedeploy.api.predictors",
    "fly": "wakedeploy.api.flights",
    "Flight": "wakedeploy.api.flights",
    "Flights": "wakedeploy.api.flights",
    "close_gap": "wakedeploy.api.gaps",
    "Gap": "wakedeploy.api.gaps",
    "System": "wakedeploy.gap.systems.own_system",
    "Input": "wakedeploy.gap.systems.system",
    "Output": "wakedeploy.gap.systems.system",
    "Constant": "wakedeploy.gap.systems.system",
    "Port": "wakedeploy.gap.systems.ports",
    "MjcfSystem": "wakedeploy.gap.systems.mjcf.system",
    "WakedeployError": "wakedeploy.core.errors",
    "UnusableInput": "wakedeploy.core.errors",
    "CheckFailed": "wakedeploy.core.errors",
    "OutOfRange": "wakedeploy.core.errors",
}
__all__ = ["__version__", *_FROM]


def __getattr__(name: str) -> object:
    """Load a public name from its module when it is first asked for."""
    if name not in _FROM:
        raise AttributeError(f"module 'wakedeploy' has no attribute {name!r}")
    value = getattr(importlib.import_module(_FROM[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """What tab completion offers: the public names, and what was imported already."""
    return sorted({*globals(), *_FROM})
