"""The report says what the artefacts say, loads nothing, and survives whatever is in the files."""

import json
from html.parser import HTMLParser
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from wakedeploy.errors import UnusableInput
from wakedeploy.gap.account import account, closed_share
from wakedeploy.gap.markup import element, table
from wakedeploy.gap.report import PICTURES, write_report
from wakedeploy.gap.report_maps import strongest_maps
from wakedeploy.gap.steps import read_steps
from wakedeploy.gap.telling import confidence, measured, percent, probability, quantity, span
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
VOID = {"img", "meta"}


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
        "q_value": min(1.0, 0.001 * 3.0**index),
    }  # fmt: skip


def white(rng, passes):
    lags = list(range(1, 33))
    correlation = rng.normal(0, 0.015, 32) + (0.0 if passes else 0.5) * 0.8 ** np.arange(32)
    statistic, p = (31.0, 0.4) if passes else (800.0, 1e-9)
    return {
        "p_value": p, "statistic": statistic, "limit": 34.0, "passes": passes, "lags": lags,
        "autocorrelation": list(correlation),
    }  # fmt: skip


def spectrum(rng, coloured):
    hz = np.linspace(0.0, 16.0, 129)
    density = (1 + coloured * 6 / (1 + hz**2)) * rng.gamma(12, 1 / 12, 129)
    return {"frequency_hz": list(hz), "density": list(density), "low": 0.5, "high": 1.67}


def find_artefact(rng, maps=12):
    places = [
        {"channel": "force", "coordinate": "height", "exogenous": False, "low": 0.0, "high": 0.25,
         "residual": 0.41, "unit": "N", "coordinate_unit": "m", "q_value": 0.001,
         "words": "below 0.25 m: force +0.41 N"},
        {"channel": "control effort", "coordinate": "source command", "exogenous": True,
         "low": 2.0, "high": 3.5, "residual": -0.12, "unit": "N", "coordinate_unit": "N",
         "q_value": 0.004},
    ]  # fmt: skip
    flights = [f"flight{i}" for i in range(7)]
    return {
        "rig_sha256": "ab" * 32,
        "logs": [
            {"path": f"logs/{name}.mcap", "sha256": "cd" * 32, "seconds": 20.0, "samples": 640,
             "notes": ["2 outliers"] if name == "flight3" else []}
            for name in flights
        ],
        "split": {"fit": flights[:5], "sealed": flights[5:]},
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
        "effects": [effect] if verdict in ("named", "class") else [],
        "class": NAMES[:2] if verdict == "class" else [],
        "split_by": "thrust steps at two separations" if verdict == "class" else "",
        "sentence": "In short.", "rounds": rounds,
        "confusion": {"names": NAMES, "loss_nats": loss.tolist()},
        "detectable": {n: {"parameter": "size", "size": 0.012, "unit": "s"} for n in NAMES}
        | {"lost-steps": {"parameter": "lost_per_m", "size": None, "unit": "1"}},
        "unknown": {"coordinates": ["height", "source command"], "gain_nats": 88.0,
                    "expression": "0.31 * exp(-z / 0.2) * u_source"}
        if verdict == "unknown" else None,
        "white": white(rng, verdict != "unknown"),
        "noise": {"range noise": {"value": 0.004, "unit": "m"}}, "seconds": 31.0,
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
        "sealed": ["flight5", "flight6"], "cross_validated": False,
        "gap": {
            name: {"before": b, "after": a, "noise_floor": f, "unit": unit,
                   "before_interval": [0.9 * b, 1.1 * b], "after_interval": [0.93 * a, 1.07 * a],
                   "closed": (b**2 - a**2) / (b**2 - f**2)}
            for name, (b, a, f, unit) in gap.items()
        },
        "places": [
            {"coordinate": name, "edges": list(np.linspace(0, 1, 9)), "unit": "m",
             "before": list(rng.uniform(0.015, 0.03, 8)),
             "after": list(rng.uniform(0.01, 0.014, 8))}
            for name in COORDINATES
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


def fabricate(out: Path, verdict="named", maps=12, upto="result"):
    rng = np.random.default_rng(3)
    name = name_artefact(rng, verdict)
    artefacts = {"find": find_artefact(rng, maps), "name": name}
    if verdict != "none":
        artefacts |= {"add": add_artefact(), "show": show_artefact(rng)}
    artefacts["result"] = {k: name[k] for k in ("verdict", "effects", "class")} | {"plan": {}}
    out.mkdir(parents=True, exist_ok=True)
    for step, content in artefacts.items():
        (out / f"{step}.json").write_text(json.dumps(content), encoding="utf-8")
        if step == upto:
            break
    return artefacts


class Reader(HTMLParser):
    """Checks that elements nest, and gathers text, headings, pictures and what would be loaded."""

    def __init__(self, page: str):
        super().__init__()
        self.open, self.text, self.pictures, self.loaded = [], [], [], []
        self.ids, self.links, self.tags = set(), set(), set()
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.add(tag)
        given = dict(attrs)
        self.ids |= {given["id"]} if "id" in given else set()
        self.links |= {given["href"]} if tag == "a" else set()
        for key in ("src", "href", "srcset", "data", "action"):
            if key in given and not given[key].startswith(("data:image/png;base64,", "#")):
                self.loaded.append(given[key])
        if tag == "img":
            self.pictures.append(given)
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def read_page(path: Path) -> Reader:
    page = path.read_text(encoding="utf-8")
    reader = Reader(page)
    assert page.startswith("<!DOCTYPE html>")
    assert reader.loaded == []
    assert not reader.tags & {"script", "link", "iframe", "object"}
    assert "url(" not in page
    assert "@import" not in page
    assert {f"#{name}" for name in reader.ids} >= reader.links
    return reader


@pytest.fixture(scope="module")
def full(tmp_path_factory):
    out = tmp_path_factory.mktemp("full")
    fabricate(out)
    return out, read_page(write_report(out))


def test_every_figure_is_drawn_embedded_and_not_blank(full):
    out, reader = full
    names = {f"{each.name}.png" for each in PICTURES}
    assert {path.name for path in (out / "figures").iterdir()} == names
    assert len(reader.pictures) == len(names)
    for picture in reader.pictures:
        assert len(picture["alt"]) > 20
    for path in (out / "figures").iterdir():
        pixels = matplotlib.image.imread(path)[..., :3]
        assert pixels.shape[1] > 500
        assert pixels.std() > 0.03  # ink on paper


def test_the_page_tells_verdict_value_and_share_closed(full):
    text = " ".join(full[1].text)
    assert "Effect missing from the model: spool-lag-sufferer." in text
    assert "52 ms (47 to 59)" in text
    assert "21.3 mm" in text
    assert "96 % of the gap closed" in text
    assert "range-drift, does not help" in text
    assert "below 0.25 m: force +0.41 N" in text
    assert "Next step" not in text


def test_an_unfinished_folder_says_which_step_comes_next(tmp_path):
    fabricate(tmp_path, maps=1, upto="find")
    text = "".join(read_page(write_report(tmp_path)).text)
    assert "Next step: wakedeploy gap name" in text
    for upto, step in (("name", "add"), ("add", "show"), ("show", None)):
        fabricate(tmp_path, upto=upto)
        assert read_steps(tmp_path).missing == step


def test_an_empty_folder_begins_with_find(tmp_path):
    text = "".join(read_page(write_report(tmp_path)).text)
    assert "Next step: wakedeploy gap find" in text
    assert not (tmp_path / "figures").exists()


def test_no_effect_needs_no_further_step_and_leaves_no_old_figure(tmp_path):
    stale = tmp_path / "figures" / "before_after.png"
    stale.parent.mkdir()
    stale.write_bytes(b"of an earlier run")
    fabricate(tmp_path, "none", maps=0)
    text = "".join(read_page(write_report(tmp_path)).text)
    assert "Nothing is missing from the model beyond noise." in text
    assert "Next step" not in text
    assert not stale.exists()


def test_what_is_not_finite_becomes_a_dash_and_what_is_text_stays_text(tmp_path):
    evil = "<script>alert('$x_1$ & \"q\"')</script>"
    artefacts = fabricate(tmp_path, "class", maps=1)
    for step, content in artefacts.items():
        spoilt = spoil(content, evil)
        (tmp_path / f"{step}.json").write_text(json.dumps(spoilt), encoding="utf-8")
    reader = read_page(write_report(tmp_path))
    assert evil in "".join(reader.text)
    assert "nan" not in "".join(reader.text).lower().split()


def spoil(value, evil):
    """Every second number null, every text a piece of HTML and mathematics."""
    if isinstance(value, dict):
        return {
            key: entry if key in ("verdict", "coordinate") else spoil(entry, evil)
            for key, entry in value.items()
        }
    if isinstance(value, list):
        whole = [spoil(entry, evil) for entry in value]
        numeric = value and isinstance(value[0], float)
        return [None if numeric and i % 2 else e for i, e in enumerate(whole)]
    if isinstance(value, float):
        return value if value > 0.1 else None
    return evil if isinstance(value, str) else value


def test_a_broken_artefact_is_named(tmp_path):
    (tmp_path / "name.json").write_text('{"verdict": ', encoding="utf-8")
    with pytest.raises(UnusableInput, match=r"name\.json.*run the step"):
        write_report(tmp_path)
    (tmp_path / "name.json").write_text("[1]", encoding="utf-8")
    with pytest.raises(UnusableInput, match="no JSON object"):
        write_report(tmp_path)


@pytest.mark.parametrize(
    ("verdict", "expected"),
    [
        ("named", ["Effect missing from the model: spool-lag-sufferer.", "over 99 % sure"]),
        (
            "class",
            ["either spool-lag-sufferer or command-latency", "thrust steps at two separations"],
        ),
        ("unknown", ["no known effect explains it", "height and source command", "exp(-z / 0.2)"]),
        (
            "none",
            [
                "Nothing is missing",
                "spool-lag-sufferer, size off by 12.0 ms",
                "20 more in the report",
            ],
        ),
    ],
)
def test_the_account_of_each_verdict(tmp_path, verdict, expected):
    fabricate(tmp_path, verdict)
    told = account(read_steps(tmp_path).summary)
    for sentence in expected:
        assert sentence in told


def test_the_account_needs_no_more_than_a_verdict():
    for verdict in ("named", "class", "unknown", "none", None):
        assert account({"verdict": verdict})


def test_the_account_says_how_little_it_rests_on():
    told = account({"verdict": "named", "effects": [{"name": "stiction"}], "logs": [{}],
                    "cross_validated": True})  # fmt: skip
    assert "too few flights to seal" in told
    assert "a hint, not a finding" in told


def test_a_placebo_that_helps_is_a_warning():
    placebo = {"name": "range-drift", "before": 2.0, "after": 1.0, "unit": "N", "helps": True}
    assert "Careful" in account({"verdict": "named", "placebo": placebo})


def test_twelve_maps_at_most_the_most_significant_of_both_kinds():
    rng = np.random.default_rng(0)
    maps = [fabricated_map(rng, i) for i in range(30)]
    exogenous, fed_back = strongest_maps({"maps": maps[::-1]})
    assert (len(exogenous), len(fed_back)) == (6, 6)
    assert [m["q_value"] for m in exogenous] == [m["q_value"] for m in maps[:6]]
    assert len(strongest_maps({"maps": [m for m in maps if m["exogenous"]]})[0]) == 12


def test_numbers_carry_the_digits_that_their_interval_allows():
    assert measured(0.05234, 0.0471, 0.0583, "s") == "52 ms (47 to 58)"
    assert measured(412.3, 350.0, 460.0, "") == "412 (350 to 460)"
    assert measured(-1.234, -1.3, -1.2, "N") == "−1.23 N (−1.30 to −1.20)"
    assert measured(None, 1.0, 2.0, "N") == "–"
    assert quantity(0.41, "N", signed=True) == "+0.41 N"
    assert quantity(13.0, "us") == "13.0 µs"
    assert span(2.0, 3.5, "N") == "from 2.00 to 3.50 N"
    assert quantity(float("inf"), "N") == "–"
    assert (percent(0.96), percent(None), percent(-0.2)) == ("96 %", "–", "−20 %")
    assert (confidence(1.0), confidence(0.5), confidence(0.0)) == ("over 99 %", "50 %", "under 1 %")
    assert (probability("q", 0.0001), probability("p", 0.25)) == ("q < 0.001", "p = 0.25")


def test_the_share_closed_is_of_squares_above_the_floor():
    assert closed_share({"before": 5.0, "after": 4.0, "noise_floor": 3.0}) == pytest.approx(9 / 16)
    assert np.isnan(closed_share({"before": 3.0, "after": 3.0, "noise_floor": 3.0}))


def test_markup_escapes_everything_but_markup():
    cell = element("b", "<i>", title='"')
    assert cell == '<b title="&quot;">&lt;i&gt;</b>'
    assert cell in table(["<"], [[cell]])
