"""Small artefacts of the gap workflow's steps, as each of the verdicts leaves them, made up."""

from typing import Any

import numpy as np

from wakedeploy.gap.report.shrinkage import FORECAST
from wakedeploy.gap.rules import FEWEST_IN_ALL
from wakedeploy.gap.systems.gantry import artefacts as types
from wakedeploy.gap.systems.gantry import findings

Artefact = dict[str, Any]

FLIGHTS = tuple(f"flights/flight{i}.csv" for i in range(FEWEST_IN_ALL))
NAMED, RIVAL = "spool-lag-sufferer", "command-latency"
_KINDS: dict[str, type[types.Artefact]] = {
    "find": types.Find, "name": types.Name, "add": types.Add, "show": types.Show,
    "plan": types.Plan, "result": types.Result,
}  # fmt: skip
VERDICTS = ("named", "class", "unknown", "none", "inconclusive")


def folder(verdict: str, rig_sha256: str, logs: list[str]) -> dict[str, Artefact]:
    """The artefacts of all steps that have something to say under a verdict."""
    flights = 1 if verdict == "inconclusive" else len(logs)
    name = _name(verdict)
    by_step = {"find": _find(rig_sha256, logs[:flights]), "name": name}
    if verdict in ("named", "class", "unknown"):
        by_step["add"] = _add(rig_sha256)
        by_step["show"] = _show()
    if verdict == "class":
        by_step["plan"] = _plan()
    by_step["result"] = _result(by_step)
    return {
        step: _KINDS[step].model_validate(content).as_json() for step, content in by_step.items()
    }


_UP = {"value": 0.052, "low": 0.046, "high": 0.058, "unit": "s"}


def _parameters(name: str) -> Artefact:
    if name == RIVAL:
        return {"latency_s": _UP}
    return {"up_s": _UP, "down_s": _UP | {"at_bound": True}}


def _white(passes: bool) -> Artefact:
    return {
        "p_value": 0.4, "statistic": 31.0, "limit": 34.0, "passes": passes, "lags": [1, 2, 3],
        "autocorrelation": [0.01, -0.02, 0.015], "samples": 1900,
    }  # fmt: skip


def _spectrum() -> Artefact:
    hz = np.linspace(0.0, 16.0, 9)
    return {"frequency_hz": list(hz), "density": list(1.0 + 0.1 * hz), "low": 0.5, "high": 1.67}


def _place(coordinate: str) -> Artefact:
    return {
        "channel": "force", "coordinate": coordinate, "exogenous": coordinate == "time",
        "low": 0.0, "high": 0.25, "residual": 0.41, "unit": "N", "coordinate_unit": "m",
        "q_value": 0.001, "clarity": 5.0,
        "words": f"{coordinate} below 0.25 m: force +0.41 N, q = 0.001",
    }  # fmt: skip


def _map(coordinate: str) -> Artefact:
    return {
        "channel": "force", "coordinate": coordinate, "exogenous": coordinate == "time",
        "unit": "N", "coordinate_unit": "m", "edges": [0.0, 0.25, 0.5, 1.0],
        "mean": [0.1, -0.02, 0.01], "low": [0.05, -0.05, -0.02], "high": [0.15, 0.01, 0.04],
        "count": [64, 20, 1], "blocks": [3, 2, 1], "q_value": 0.02,
        "p_value": 0.01, "clarity": 5.0, "strength": 3.0,
    }  # fmt: skip


def _find(rig_sha256: str, logs: list[str]) -> Artefact:
    split = len(logs) - (1 if len(logs) >= FEWEST_IN_ALL else 0)
    names = [FLIGHTS[i] for i in range(len(logs))]
    return {
        "rig": "rig.toml", "rig_sha256": rig_sha256,
        "logs": [
            {"path": name, "sha256": sha256, "seconds": 20.0, "samples": 640, "notes": ["ok"],
             "seed": i, "simulated": i > 0}
            for i, (name, sha256) in enumerate(zip(names, logs, strict=True))
        ],
        "split": {"fit": names[:split], "sealed": names[split:]},
        "white": _white(False), "places": [_place("height"), _place("time")],
        "maps": [_map("height"), _map("time")], "spectrum": _spectrum(),
        "replay": [{"horizon_s": 0.25, "rmse_m": 0.01, "expected_m": 0.008},
                   {"horizon_s": 1.0, "rmse_m": 0.03, "expected_m": 0.02}],
        "noise_floor": {"force": {"value": 0.08, "unit": "N"}},
        "sentence": "They disagree in 2 places.",
    }  # fmt: skip


def _ranked(name: str, gain: float) -> Artefact:
    return {
        "name": name, "gain_nats": gain, "interval": [gain - 2.0, gain + 6.0],
        "confidence": 0.97, "parameters": _parameters(name),
    }  # fmt: skip


_BENT = {"name": "wake.speed_mps", "stated": 6.0, "spread": 0.1, "fitted": 6.5,
         "away_sd": 5.0}  # fmt: skip


def _name(verdict: str) -> Artefact:
    effect = {"name": NAMED, "confidence": 0.998, "gain_nats": 41.0,
              "parameters": _parameters(NAMED)}  # fmt: skip
    force = {"value": 0.31, "low": 0.2, "high": 0.4, "unit": "N"}
    unknown = {"coordinates": ["height"], "gain_nats": 88.0, "terms": ["exp"],
               "expression": "c1*exp(-z_m/0.2)", "text": "0.31 N * exp(-z_m/0.2)",
               "parameters": {"c1": force}}  # fmt: skip
    leading = {"clear": True, "names": [NAMED], "others": [RIVAL], "gain_nats": 12.0,
               "next": RIVAL, "next_nats": 3.0, "threshold_nats": 9.0}  # fmt: skip
    return {
        "verdict": verdict,
        "effects": [effect] if verdict == "named" else [],
        "class": [NAMED, RIVAL] if verdict == "class" else [],
        "more_classes": [["stiction", "range-bias"]] if verdict == "class" else [],
        "others": ["stiction"] if verdict == "class" else [],
        "leading": leading if verdict == "inconclusive" else None,
        "untried": ["stiction"] if verdict == "inconclusive" else [],
        "split_by": "thrust steps at two separations" if verdict == "class" else "",
        "rounds": [
            {"given": [], "found": NAMED, "near_nats": 3.0, "threshold_nats": 9.3,
             "ranking": [_ranked(NAMED, 412.0), _ranked(RIVAL, 12.0)]},
            {"given": [NAMED], "found": "", "near_nats": 3.0, "threshold_nats": None,
             "ranking": [_ranked(RIVAL, -1.0)]},
        ],
        "confusion": {"names": [NAMED, RIVAL], "loss_nats": [[0.0, 20.0], [2.0, 0.0]]},
        "detectable": {NAMED: {"parameter": "up_s", "size": 0.012, "unit": "s"},
                       RIVAL: {"parameter": "latency_s", "size": None, "unit": "s"}},
        "unknown": unknown if verdict == "unknown" else None,
        "rest": {"text": "0.01 N * x_m", "gain_nats": 4.0} if verdict == "named" else None,
        "together": [{"name": NAMED, "parameters": _parameters(NAMED)}],
        "beside": [{"name": RIVAL, "parameters": _parameters(RIVAL)}] * (verdict == "unknown"),
        "calibration": [_BENT],
        "white": _white(verdict != "unknown"), "fitted_flights": 3, "threshold_of_s": 100.0,
        "noise": {"range": {"value": 0.004, "unit": "m"}}, "seconds": 31.0,
    }  # fmt: skip


def _add(rig_sha256: str) -> Artefact:
    return {"rig": "rig.toml", "old_sha256": rig_sha256, "new_sha256": "ef" * 32,
            "effects": [{"name": NAMED, "parameters": {"up_s": _UP}}]}  # fmt: skip


def _show() -> Artefact:
    t_s = list(np.arange(0.0, 1.0, 0.125))
    channel = {"before": 0.0213, "after": 0.0124, "noise_floor": 0.0119, "unit": "m",
               "before_interval": [0.019, 0.023], "after_interval": [0.011, 0.013],
               "closed": 0.97}  # fmt: skip
    return {
        "sealed": [FLIGHTS[-1]], "in_sample": False, "cross_validated": False, "as_if": [],
        "gap": {FORECAST: channel, "force": channel | {"unit": "N"}},
        "places": [{"coordinate": "height", "channel": "force", "edges": [0.0, 0.5, 1.0],
                    "unit": "m", "coordinate_unit": "m",
                    "before": [0.02, 0.03], "after": [0.01, 0.012],
                    "before_reach": [0.001, 0.002], "after_reach": [0.001, 0.001]}],
        "placebo": {"name": "range-drift", "before": 0.0213, "after": 0.0212, "unit": "m",
                    "gain_nats": 1.2, "found_gain_nats": 40.0, "helps": True},
        "white": {"before": _white(False), "after": _white(True)},
        "spectrum": {"before": _spectrum(), "after": _spectrum()},
        "traces": {"t_s": t_s, "measured_m": t_s, "before_m": t_s, "after_m": t_s[::-1]},
        "retrain": {"unit": "N", "old_rmse": 0.21, "new_rmse": 0.13},
        "hidden_by": [_BENT], "log_density_gain_nats": 12.0,
    }  # fmt: skip


def _plan() -> Artefact:
    option = {"manoeuvre": "still-air", "description": "hover", "seconds": 30.0,
              "loss_nats": [[0.0, 9.0], [8.0, 0.0]], "worst_nats": 8.0, "flights": 1}  # fmt: skip
    return {
        "class": [NAMED, RIVAL], "sentence": "To split them, fly still-air.",
        "manoeuvre": "still-air", "flights": 1, "seconds": 30.0,
        "split_by": {NAMED: "steps", RIVAL: "steps"}, "is_searched": True,
        "margin_nats": 5.9, "options": [option],
    }  # fmt: skip


def _split(plan: Artefact | None) -> Artefact | None:
    return plan and {key: plan[key] for key in findings.Splitting.model_fields}


def _result(by_step: dict[str, Artefact]) -> Artefact:
    """As `close.result` makes it of the steps."""
    name, show = by_step["name"], by_step.get("show", {})
    kept = ("effects", "class", "more_classes", "others", "unknown", "beside", "rest",
            "calibration", "detectable", "leading", "verdict")  # fmt: skip
    return {key: name[key] for key in kept} | {
        "members": [{"name": NAMED, "confidence": 0.9, "parameters": _parameters(NAMED)}],
        "where": by_step["find"]["places"],
        "gap": show.get("gap", {}), "placebo": show.get("placebo"),
        "plan": _split(by_step.get("plan")), "as_if": [], "hidden_by": show.get("hidden_by", []),
        "log_density_gain_nats": show.get("log_density_gain_nats"), "in_sample": False,
        "cross_validated": False, "flights": len(by_step["find"]["logs"]),
        "headline": "Effect missing.", "next": None,
    }  # fmt: skip
