"""The report says what the artefacts say, loads nothing, and survives whatever is in the files."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import matplotlib.image
import numpy as np
import pytest
from click.testing import CliRunner
from fabricated_artefacts import NAMES, fabricate, fabricated_map, summary

from wakedeploy.cli import main
from wakedeploy.cli.gap_plan import plan
from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.report.maps import strongest_maps
from wakedeploy.gap.report.page import PICTURES, write_report
from wakedeploy.gap.report.summary import account
from wakedeploy.gap.search.artefacts import Map
from wakedeploy.gap.systems.gantry.artefacts import Plan
from wakedeploy.gap.systems.gantry.folder import read_steps
from wakedeploy.gap.systems.gantry.search.before_after import closed_share
from wakedeploy.gap.wording import confidence, measured, percent, probability, quantity, span

VOID = {"img", "meta"}
LAG = "the sufferer's rotor speed follows its command with a first-order lag (`spool-lag-sufferer`)"


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
    assert not reader.tags & {"link", "iframe", "object"}
    assert page.count("<script") == 1  # what sorts tables: tests/core/test_markup.py
    assert "url(" not in page
    assert "@import" not in page
    assert {f"#{name}" for name in reader.ids} >= reader.links
    return reader


@pytest.fixture
def undrawn(monkeypatch):
    """Pages without their pictures, which take most of the time."""
    monkeypatch.setattr("wakedeploy.gap.report.page.PICTURES", ())


@pytest.fixture(scope="module")
def full(tmp_path_factory):
    out = tmp_path_factory.mktemp("full")
    fabricate(out)
    return out, read_page(write_report(out))


@pytest.mark.whole
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


@pytest.mark.whole
def test_each_row_of_the_ranking_says_its_gain(full):
    page = (full[0] / "report.html").read_text("utf-8")
    assert re.search(r"<title>spool-lag-sufferer: \d+ nats \(\d+ to \d+\)</title>", page)
    assert page.count("On top of ") >= 2


@pytest.mark.whole
def test_the_page_tells_verdict_value_and_share_closed(full):
    text = " ".join(full[1].text)
    assert "Missing from the model: the sufferer's rotor speed follows its command" in text
    assert "<code>spool-lag-sufferer</code>" in (full[0] / "report.html").read_text("utf-8")
    assert "52 ms (47 to 59)" in text
    assert "21.3 mm" in text
    assert "96 % of the gap closed" in text
    assert "the best wrong effect range-drift in its place, does not help" in text
    assert "below 0.25 m: force +0.41 N" in text
    assert "Next step" not in text


@pytest.mark.whole
def test_an_unfinished_folder_says_which_step_comes_next(tmp_path):
    fabricate(tmp_path, maps=1, upto="find")
    text = "".join(read_page(write_report(tmp_path)).text)
    assert "Next step: name the effect that explains it.wakedeploy gap name" in text
    for upto, step in (("name", "add"), ("add", "show"), ("show", None)):
        fabricate(tmp_path, upto=upto)
        assert read_steps(tmp_path).missing == step


def test_an_empty_folder_begins_with_find(tmp_path):
    text = "".join(read_page(write_report(tmp_path)).text)
    assert "Next step: find where simulation and measurement disagree.wakedeploy gap find" in text
    assert "Nothing: the rig file stays." not in text
    assert not (tmp_path / "figures").exists()


@pytest.mark.whole
def test_no_effect_needs_no_further_step_and_leaves_no_old_figure(tmp_path):
    stale = tmp_path / "figures" / "before_after.png"
    stale.parent.mkdir()
    stale.write_bytes(b"of an earlier run")
    fabricate(tmp_path, "none", maps=0)
    text = "".join(read_page(write_report(tmp_path)).text)
    assert "Nothing is missing from the model beyond noise." in text
    assert "Next step" not in text
    assert not stale.exists()


@pytest.mark.whole
def test_what_is_not_finite_becomes_a_dash_and_what_is_text_stays_text(tmp_path):
    evil = "<script>alert('$x_1$ & \"q\"')</script>"
    artefacts = fabricate(tmp_path, "class", maps=1)
    for step, content in artefacts.items():
        spoilt = spoil(content, evil, step != "add")  # a rig file's values are numbers
        (tmp_path / f"{step}.json").write_text(json.dumps(spoilt), encoding="utf-8")
    reader = read_page(write_report(tmp_path))
    assert evil in "".join(reader.text)
    assert "nan" not in "".join(reader.text).lower().split()


def spoil(value, evil, numbers):
    """Every second number null, every text a piece of HTML and mathematics."""
    if isinstance(value, dict):
        return {
            key: entry if key in ("verdict", "coordinate", "rules") else spoil(entry, evil, numbers)
            for key, entry in value.items()
        }
    if isinstance(value, list):
        whole = [spoil(entry, evil, numbers) for entry in value]
        numeric = numbers and value and isinstance(value[0], float)
        return [None if numeric and i % 2 else e for i, e in enumerate(whole)]
    if isinstance(value, float):
        return None if numbers and value <= 0.1 else value
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
        ("named", [f"Missing from the model: {LAG}.", "over 99 % sure"]),
        (
            "class",
            [f"either {LAG} or a command reaches", "thrust steps at two separations"],
        ),
        (
            "unknown",
            ["no known effect explains it", "height and source command", "0.31 N exp(-z / 0.2 m)"],
        ),
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


def test_every_open_class_is_told():
    open_ones = [["viscous-friction", "coulomb-friction"], ["battery-sag", "range-drift"]]
    result = {"verdict": "class", "class": ["range-bias", "range-scale"], "more_classes": open_ones}
    told = account(summary(result)).splitlines()[0]
    assert "Missing from the model: either the range sensor reads too much" in told
    assert "(`range-scale`); these flights cannot tell which." in told
    assert "Besides, `viscous-friction` or `coulomb-friction` is missing." in told
    assert "Besides, `battery-sag` or `range-drift` is missing." in told


def test_the_account_needs_no_more_than_a_verdict():
    for verdict in ("named", "class", "unknown", "none", None):
        assert account(summary({"verdict": verdict}))


def test_the_account_says_how_little_it_rests_on():
    sure = {"name": "stiction", "confidence": 0.999}
    result = {"verdict": "named", "effects": [sure], "flights": 3, "cross_validated": True}
    told = account(summary(result))
    assert "too few flights to seal" in told
    assert "Three flights say so; one more has to confirm it." in told
    assert "% sure" not in told


def test_the_account_says_what_was_assumed_and_how_far_it_is_from_what_was_tried():
    logs = [{"path": f"runs/f{i}.mcap", "seconds": 90.0, "notes": []} for i in range(4)]
    logs[1]["notes"] = ["the source is off"]
    result = {"verdict": "named", "effects": [{"name": "stiction"}], "logs": logs,
              "split": {"fit": [log["path"] for log in logs]}, "threshold_of_s": 100.0}  # fmt: skip
    told = account(summary(result))
    assert "In f1.mcap: the source is off." in told
    assert "simulated for 100 s of flight, these are 360 s" in told
    assert "simulated for" not in account(summary(result | {"threshold_of_s": 200.0}))
    for log in logs:
        log["notes"] = ["the source is off"]
    assert account(summary(result)).count("In every flight: the source is off.") == 1


def test_the_account_does_not_call_unknown_sizes_implausible():
    sizes = {"ground-effect": {"parameter": "gain", "size": 0.03, "unit": "1", "known": True},
             "belt-backlash": {"parameter": "backlash_m", "size": None, "unit": "m", "known": True},
             "pwm-dead-band": {"parameter": "band_us", "size": None, "unit": "us", "known": False},
             }  # fmt: skip
    told = account(summary({"verdict": "none", "detectable": sizes}))
    assert "No plausible size of these would have shown: belt-backlash." in told
    assert "From which size these would have shown is not known: pwm-dead-band." in told


def test_the_account_tells_the_retrained_predictors_by_either_force():
    scores = {"unit": "N", "old_rmse": 0.2, "new_rmse": 0.1}
    by_old = {"old_rmse": 0.3, "new_rmse": 0.25}
    told = account(summary({"verdict": "named", "retrain": scores | {"by_old_label": by_old}}))
    assert "by the force that the old one measures, 0.250 N and 0.30 N" in told
    assert "over flights" not in told
    for ends, open_ in (([0.3, 1.6], True), ([0.3, 0.8], False)):
        sure = scores | {"ratio": 0.5, "ratio_interval": ends}
        told = account(summary({"verdict": "named", "retrain": sure}))
        assert f"That is 0.50 of it, 0.30 to {ends[1]:.2f} over flights" in told
        assert ("they cannot tell whether it helps" in told) is open_


def test_a_plan_takes_the_place_of_what_the_library_says_splits():
    result = {"verdict": "class", "class": NAMES[:3], "split_by": "a sensor"}
    assert "What would tell them apart: a sensor." in account(summary(result))
    size = {"value": 0.5, "low": 0.4, "high": 0.6, "unit": "N"}
    told = account(
        summary(result | {"members": [{"name": "b", "parameters": {"coulomb_n": size}}]})
    )
    assert "If it is b: coulomb 0.50 N (0.40 to 0.60)." in told
    planned = account(summary(result | {"plan": {"sentence": "Fly steps.", "manoeuvre": "steps"}}))
    assert "Fly steps." in planned
    assert "writes it with --write-reference FILE" in planned
    assert "looks for the manoeuvre" not in planned
    assert "a sensor" not in planned


@pytest.mark.usefixtures("undrawn")
def test_a_plan_made_later_reaches_result_and_report(tmp_path, monkeypatch):
    left = fabricate(tmp_path, "class")
    names = tuple(left["result"]["class"])
    told = Plan(rivals=names, sentence="Fly slow triangles.", manoeuvre="triangles", flights=3,
                seconds=60.0, is_searched=True)  # fmt: skip
    made = SimpleNamespace(names=names, best=None, as_artefact=told)
    monkeypatch.setattr(
        "wakedeploy.gap.systems.gantry.planning.plan.make_plan", lambda *_, **__: made
    )
    monkeypatch.setattr("wakedeploy.cli.gap_plan._tell_plan", lambda _: None)
    monkeypatch.setattr("wakedeploy.cli.gap_plan._same_rig", lambda *_: None)
    run = CliRunner().invoke(plan, ["--out", str(tmp_path)])
    assert run.exit_code == 0, run.output
    assert json.loads((tmp_path / "plan.json").read_text("utf-8")) == told.as_json()
    written = json.loads((tmp_path / "result.json").read_text("utf-8"))["plan"]
    assert (written["manoeuvre"], written["flights"]) == ("triangles", 3)
    assert "Fly slow triangles" in (tmp_path / "report.html").read_text("utf-8")


def test_an_expression_is_shown_with_its_coefficients(tmp_path):
    fabricate(tmp_path, "unknown", maps=2)
    for unneeded in ("find", "show"):
        (tmp_path / f"{unneeded}.json").unlink()
    text = " ".join(read_page(write_report(tmp_path)).text)
    assert "a * exp(-z_m / 0.2)" in text
    assert "0.31 N (0.20 to 0.40)" in text


def test_a_placebo_that_helps_is_a_warning():
    placebo = {"name": "range-drift", "before": 2.0, "after": 1.0, "unit": "N", "helps": True}
    assert "Careful" in account(summary({"verdict": "named", "placebo": placebo}))


def test_beside_nothing_a_place_is_told_as_too_little():
    place = {"words": "height above 0.9 m: +0.01 N (force), q = 0.04", "q_value": 0.04}
    told = account(summary({"verdict": "none", "places": [place]}))
    assert "Too little to say that something is missing (q = 0.04): height above 0.9 m" in told
    assert "It shows most" not in told
    assert "It shows most (q = 0.04) at height" in account(
        summary({"verdict": "named", "places": [place]})
    )


def test_an_error_below_the_noise_is_told_as_noise_and_not_as_more_than_all():
    error = {"before": 0.012, "after": 0.0053, "noise_floor": 0.0056, "unit": "m"}
    told = account(summary({"verdict": "named", "gap": {"height 0.25 s ahead": error}}))
    assert "where noise alone gives 5.6 mm: no more is left than noise." in told
    assert "100 %" not in told


@pytest.mark.parametrize(("nats", "said"), [(1.0, "not help"), (9.0, "a little"), (40.0, "less"),
                                            (90.0, "as well")])  # fmt: skip
def test_how_far_a_placebo_helps_is_told_against_what_was_found(nats, said):
    placebo = {"name": "range-drift", "before": 2.0, "after": 1.0, "unit": "N", "helps": nats > 3.0}
    placebo |= {"gain_nats": nats, "found_gain_nats": 100.0}
    told = account(summary({"verdict": "named", "placebo": placebo}))
    assert said in told
    assert ("Careful" in told) is (nats == 90.0)


def test_twelve_maps_at_most_the_most_significant_of_both_kinds():
    rng = np.random.default_rng(0)
    maps = [Map(**fabricated_map(rng, i)) for i in range(30)]
    exogenous, fed_back = strongest_maps(maps[::-1])
    assert (len(exogenous), len(fed_back)) == (6, 6)
    assert exogenous == maps[:6]
    assert len(strongest_maps([m for m in maps if m.exogenous])[0]) == 12


def test_numbers_carry_the_digits_that_their_interval_allows():
    assert measured(0.05234, 0.0471, 0.0583, "s") == "52 ms (47 to 58)"
    assert measured(412.3, 350.0, 460.0, "") == "412 (350 to 460)"
    assert measured(-1.234, -1.3, -1.2, "N") == "−1.23 N (−1.30 to −1.20)"
    assert measured(None, 1.0, 2.0, "N") == "–"
    assert measured(0.00556, 0.00172, 0.0375, "rad/s") == "0.0056 rad/s (0.0017 to 0.0375)"
    assert measured(0.0041, 0.0, 0.08, "rad/s") == "0.00 rad/s (0.00 to 0.08)"
    assert measured(3.2, 1e-9, 60.0, "N") == "3.20 N (0.00 to 60.00)"
    assert quantity(0.41, "N", signed=True) == "+0.41 N"
    assert quantity(13.0, "us") == "13.0 µs"
    assert span(2.0, 3.5, "N") == "from 2.00 to 3.50 N"
    assert quantity(float("inf"), "N") == "–"
    assert (percent(0.96), percent(None), percent(-0.2)) == ("96 %", "–", "−20 %")
    assert (confidence(1.0), confidence(0.5), confidence(0.0)) == ("over 99 %", "50 %", "under 1 %")
    assert (probability("q", 0.0001), probability("p", 0.25)) == ("q < 0.001", "p = 0.25")


def test_the_share_closed_is_of_squares_above_the_floor():
    assert closed_share(5.0, 4.0, 3.0) == pytest.approx(9 / 16)
    assert np.isnan(closed_share(3.0, 3.0, 3.0))


def test_what_only_a_member_of_a_class_would_close_is_said_to_be_so():
    error = {"before": 0.012, "after": 0.006, "noise_floor": 0.005, "unit": "m"}
    gap = {"height 0.25 s ahead": error}
    told = account(summary({"verdict": "class", "class": ["a", "b"], "gap": gap, "as_if": ["a"]}))
    assert "If it is a: in these flights, the error" in told


def test_a_little_that_is_left_and_a_part_that_is_known_are_told():
    named = {"verdict": "named", "effects": [{"name": "added-mass"}]}
    rest = {"text": "+ 0.1 N * x_m", "gain_nats": 9.0, "force_n": 0.008}
    told = account(summary(named | {"rest": rest}))
    assert "Its form is not exact: 8 mN are left" in told
    assert "+ 0.1 N * x_m." in told
    white = {"passes": False, "statistic": 90.0, "limit": 40.0}
    told = account(
        summary({"verdict": "unknown", "beside": [{"name": "added-mass"}], "white": white})
    )
    assert "known effects explain only a part" in told
    assert "A part of it looks like added-mass" in told
    assert "not white noise (statistic 90" in told


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(("verdict", "told"), [("named", True), ("unknown", False)])
def test_what_noise_alone_leaves_is_not_told_while_something_is_missing(tmp_path, verdict, told):
    """Nothing was added: what the fitted noise swallowed would stand there as noise."""
    fabricate(tmp_path, verdict, maps=2)
    for step in ("show", "result"):
        path = tmp_path / f"{step}.json"
        if path.exists():
            content = json.loads(path.read_text())
            for channel in content.get("gap", {}).values():
                channel |= {"before": 0.0143, "after": 0.0143, "noise_floor": 0.01319}
            path.write_text(json.dumps(content))
    shown = "".join(read_page(write_report(tmp_path)).text)
    assert "14.3 mm" in shown
    assert ("13.2 mm" in shown) is told


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("step", ["find", "name", "add", "show"])
def test_each_step_is_a_command_that_leaves_result_and_report(tmp_path, monkeypatch, step):
    """The commands around the steps, which are played by artefacts of the right shape."""
    left = fabricate(tmp_path, "named")
    for place in left["find"]["places"]:
        place["words"] = "at a height"  # of real flights each has some
    (tmp_path / "find.json").write_text(json.dumps(left["find"]), "utf-8")
    case = SimpleNamespace(flights=("a", "b", "c", "d", "e"), sealed=("f", "g"))
    monkeypatch.setattr("wakedeploy.cli.gap._case", lambda *_: case)
    function = "show_gap" if step == "show" else step
    told = getattr(read_steps(tmp_path), step)
    monkeypatch.setattr(
        f"wakedeploy.gap.systems.gantry.find_name_add_show.{function}", lambda *_, **__: told
    )
    (tmp_path / "result.json").unlink()
    given = ["--rig", "rig.toml", "--measured", "a.mcap", "--out", str(tmp_path)]
    run = CliRunner().invoke(main, ["gap", step, *given, "--json", str(tmp_path / "told.json")])
    assert run.exit_code == 0, run.output
    assert f"Report: {tmp_path / 'report.html'}" in run.output
    told = json.loads((tmp_path / "result.json").read_text("utf-8"))
    assert json.loads((tmp_path / "told.json").read_text("utf-8")) == told
    assert (told["verdict"], told["flights"]) == ("named", 7)
    assert told["headline"] == f"Missing from the model: {LAG}."
    assert told["next"] is None
    assert [e["name"] for e in told["effects"]] == [e["name"] for e in left["name"]["effects"]]
    assert "Next:" not in run.output
