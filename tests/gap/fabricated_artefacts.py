"""Artefacts as the steps of the gap workflow leave them, made up, for each of the verdicts."""

import json
from pathlib import Path

import numpy as np

from wakedeploy.gap.rules import sealed_count
from wakedeploy.gap.systems.gantry.artefacts import Add, Artefact, Find, Name, Result, Show, Summary
from wakedeploy.gap.systems.gantry.search.before_after import closed_share
from wakedeploy.physics.effects import LIBRARY

_PAIR = ["spool-lag-sufferer", "command-latency"]
NAMES = [*_PAIR, *(name for name in LIBRARY if name not in _PAIR)][:28]
COORDINATES = {
    "source command": ("N", True), "source command slope": ("N/s", True),
    "carriage position": ("m", True), "carriage speed": ("m/s", True), "time": ("s", True),
    "reference": ("m", True), "height": ("m", False), "speed": ("m/s", False),
    "own command": ("N", False), "own command slope": ("N/s", False), "separation": ("m", False),
    "forecast wake": ("N", False),
}  # fmt: skip


def fabricated_map(rng, index, bins=10):
    coordinate = list(COORDINATES)[index % len(COORDINATES)]
    unit, exogenous = COORDINATES[coordinate]
    mean = (0.3 / (index + 1)) * np.sin(np.linspace(0, 4, bins)) + rng.normal(0, 0.01, bins)
    half = rng.uniform(0.02, 0.05, bins)
    return {
        "channel": ("force", "control effort", "height 0.25 s ahead")[index % 3],
        "coordinate": coordinate, "exogenous": exogenous,
        "unit": "m" if index % 3 == 2 else "N", "coordinate_unit": unit,
        "edges": list(np.sort(rng.uniform(-1, 1, bins + 1))), "mean": list(mean),
        "low": list(mean - half), "high": list(mean + half), "count": [64] * bins,
        "q_value": min(1.0, 0.001 * 3.0**index), "p_value": 0.001, "clarity": 5.0, "strength": 3.0,
    }  # fmt: skip


def white(rng, passes):
    lags = list(range(1, 33))
    correlation = rng.normal(0, 0.015, 32) + (0.0 if passes else 0.5) * 0.8 ** np.arange(32)
    statistic, p = (31.0, 0.4) if passes else (800.0, 1e-9)
    return {
        "p_value": p, "statistic": statistic, "limit": 34.0, "passes": passes, "lags": lags,
        "autocorrelation": list(correlation), "samples": 3200,
    }  # fmt: skip


def spectrum(rng, coloured):
    hz = np.linspace(0.0, 16.0, 129)
    density = (1 + coloured * 6 / (1 + hz**2)) * rng.gamma(12, 1 / 12, 129)
    return {"frequency_hz": list(hz), "density": list(density), "low": 0.5, "high": 1.67}


def find_artefact(rng, maps=12, count=7):
    places = [
        {"channel": "force", "coordinate": "height", "exogenous": False, "low": 0.0, "high": 0.25,
         "residual": 0.41, "unit": "N", "coordinate_unit": "m", "q_value": 0.001,
         "clarity": 5.0, "words": "below 0.25 m: force +0.41 N"},
        {"channel": "control effort", "coordinate": "source command", "exogenous": True,
         "low": 2.0, "high": 3.5, "residual": -0.12, "unit": "N", "coordinate_unit": "N",
         "q_value": 0.004, "clarity": 4.0, "words": ""},
    ]  # fmt: skip
    flights = [f"logs/flight{i}.mcap" for i in range(count)]
    kept = count - sealed_count(count)
    return {
        "rig": "rig.toml", "rig_sha256": "ab" * 32,
        "logs": [
            {"path": name, "sha256": "cd" * 32, "seconds": 20.0, "samples": 640,
             "notes": ["2 outliers"] if "flight3" in name else [], "seed": i, "simulated": False}
            for i, name in enumerate(flights)
        ],
        "split": {"fit": flights[:kept], "sealed": flights[kept:]},
        "white": white(rng, False), "places": places if maps else [],
        "maps": [fabricated_map(rng, i) for i in range(maps)],
        "spectrum": spectrum(rng, 1.0),
        "replay": [{"horizon_s": h, "rmse_m": 0.03 * h**1.5, "expected_m": 0.016 * h**1.5}
                   for h in (0.25, 0.5, 1.0)],
        "noise_floor": {"force": {"value": 0.08, "unit": "N"}},
        "sentence": "They disagree in 2 places.",
    }  # fmt: skip


def parameters(value=0.052):
    return {"up_s": {"value": value, "low": 0.9 * value, "high": 1.13 * value,
                              "unit": "s"}}  # fmt: skip


def ranking(rng, best, count=28):
    gains = np.r_[best, 0.4 * best, rng.normal(-2, 4, count - 2)]
    return [
        {"name": name, "gain_nats": gain, "interval": [gain - 0.2 * abs(gain) - 2, gain + 6],
         "confidence": 0.97 if gain == best else 0.02, "parameters": parameters()}
        for name, gain in zip(NAMES, gains, strict=False)
    ]  # fmt: skip


def name_artefact(rng, verdict):
    rounds = [
        {"given": [], "threshold_nats": 9.3, "ranking": ranking(rng, 412.0)},
        {"given": NAMES[:1], "threshold_nats": 8.1, "ranking": ranking(rng, 5.0)},
    ]
    if verdict == "none":
        rounds = [
            {"given": [], "threshold_nats": 9.3, "ranking": ranking(rng, 4.0)},
            {"given": [], "threshold_nats": None, "ranking": []},
        ]
    loss = 10.0 ** rng.uniform(-1, 3, (28, 28))
    effect = {"name": NAMES[0], "confidence": 0.9984, "parameters": parameters()}
    return {
        "verdict": verdict,
        "effects": [effect] if verdict == "named" else [],
        "class": NAMES[:2] if verdict == "class" else [],
        "split_by": "thrust steps at two separations" if verdict == "class" else "",
        "rounds": rounds,
        "confusion": {"names": NAMES, "loss_nats": loss.tolist()},
        "detectable": {n: {"parameter": "size", "size": 0.012, "unit": "s"} for n in NAMES}
        | {"lost-steps": {"parameter": "lost_per_m", "size": None, "unit": "1"}},
        "unknown": {"coordinates": ["height", "source command"], "gain_nats": 88.0,
                    "expression": "a * exp(-z_m / 0.2)", "text": "0.31 N exp(-z / 0.2 m)",
                    "parameters": {"a": {"value": 0.31, "low": 0.2, "high": 0.4, "unit": "N"}}}
        if verdict == "unknown" else None,
        "white": white(rng, verdict != "unknown"),
        "noise": {"range noise": {"value": 0.004, "unit": "m"}}, "seconds": 31.0,
        "fitted_flights": 5,
    }  # fmt: skip


def add_artefact():
    effects = [{"name": NAMES[0], "parameters": parameters()}]
    return {"rig": "rig.toml", "old_sha256": "ab" * 32, "new_sha256": "ef" * 32,
            "effects": effects}  # fmt: skip


def show_artefact(rng):
    t_s = np.arange(0, 10, 1 / 32)
    height = 0.5 + 0.1 * np.sin(t_s)
    gap = {
        "height 0.25 s ahead": (0.0213, 0.0124, 0.0119, "m"), "force": (0.31, 0.11, 0.1, "N"),
        "control effort": (0.22, 0.09, 0.08, "N"),
    }  # fmt: skip
    return {
        "sealed": ["logs/flight5.mcap", "logs/flight6.mcap"], "in_sample": False,
        "gap": {
            name: {"before": b, "after": a, "noise_floor": f, "unit": unit,
                   "before_interval": [0.9 * b, 1.1 * b], "after_interval": [0.93 * a, 1.07 * a],
                   "closed": (b**2 - a**2) / (b**2 - f**2)}
            for name, (b, a, f, unit) in gap.items()
        },
        "places": [
            {"coordinate": name, "channel": "error", "coordinate_unit": unit,
             "edges": list(np.linspace(0, 1, 9)), "unit": "m",
             "before": list(rng.uniform(0.015, 0.03, 8)),
             "after": list(rng.uniform(0.01, 0.014, 8))}
            for name, (unit, _) in COORDINATES.items()
        ],
        "placebo": {"name": "range-drift", "before": 0.0213, "after": 0.0212, "unit": "m",
                    "gain_nats": -1.2, "helps": False},
        "white": {"before": white(rng, False), "after": white(rng, True)},
        "spectrum": {"before": spectrum(rng, 1.0), "after": spectrum(rng, 0.0)},
        "traces": {"t_s": list(t_s), "measured_m": list(height),
                   "before_m": list(height + 0.02 * np.sin(3 * t_s)),
                   "after_m": list(height + rng.normal(0, 0.005, len(t_s)))},
        "retrain": {"unit": "N", "old_rmse": 0.21, "new_rmse": 0.13},
    }  # fmt: skip


KINDS = {"find": Find, "name": Name, "add": Add, "show": Show, "result": Result}


def fabricate(out: Path, verdict="named", maps=12, upto="result", flights=7):
    rng = np.random.default_rng(3)
    name = name_artefact(rng, verdict)
    artefacts = {"find": find_artefact(rng, maps, flights), "name": name}
    if verdict != "none":
        artefacts |= {"add": add_artefact(), "show": show_artefact(rng)}
    artefacts["result"] = {k: name[k] for k in ("verdict", "effects", "class")}
    out.mkdir(parents=True, exist_ok=True)
    for step, content in artefacts.items():
        artefacts[step] = leave(out, step, content).as_json()
        if step == upto:
            break
    return artefacts


def leave(out: Path, step: str, content: dict) -> Artefact:
    """An artefact in a folder, as its step would have written it."""
    told = KINDS[step].model_validate(content)
    (out / f"{step}.json").write_text(json.dumps(told.as_json()), encoding="utf-8")
    return told


PLACE = {"channel": "force", "coordinate": "height", "exogenous": False, "low": 0.0, "high": 1.0,
         "residual": 0.1, "unit": "N", "coordinate_unit": "m", "q_value": 0.001, "clarity": 5.0,
         "words": ""}  # fmt: skip
WHITE = {"p_value": None, "statistic": None, "limit": None, "passes": True, "lags": [],
         "autocorrelation": [], "samples": 0}  # fmt: skip


def channel(error: dict) -> dict:
    """A channel of a gap with the share that is closed."""
    closed = closed_share(error["before"], error["after"], error["noise_floor"])
    return {"closed": closed} | error


def summary(content: dict) -> Summary:
    """What a folder says, from as much of it as a test is about."""
    told = dict(content)
    if "places" in told:
        told["places"] = [PLACE | place for place in told["places"]]
    for key in ("white", "white_before"):
        if key in told:
            told[key] = WHITE | told[key]
    if "gap" in told:
        told["gap"] = {name: channel(error) for name, error in told["gap"].items()}
    if "logs" in told:
        told["logs"] = [{"sha256": "", **log} for log in told["logs"]]
    return Summary.model_validate(told)
