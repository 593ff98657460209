"""What one to four flights may say: words, advice and verdict agree, none concludes too early.

The flights are recorded in simulated time: of a rig that lacks nothing, and of one whose wake
stands 15 cm to one side.
"""

import contextlib
import dataclasses
import html
import itertools
import json
import math
import pickle
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import drawing
import pytest
from click.testing import CliRunner
from fabricated_artefacts import PLACE, fabricate, summary
from recorded import RIG, with_effects

from wakedeploy.cli import main
from wakedeploy.cli.gap_plan import power
from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.gantry import record
from wakedeploy.gap import demo
from wakedeploy.gap.few_flights import cannot_tell, unconfirmed
from wakedeploy.gap.report.advice import advice
from wakedeploy.gap.report.page import write_report
from wakedeploy.gap.report.summary import account
from wakedeploy.gap.rules import FEWEST_IN_ALL, RULES, sealed_count
from wakedeploy.gap.search.artefacts import Place
from wakedeploy.gap.systems.gantry.artefacts import Find, Log, Result, Unflown
from wakedeploy.gap.systems.gantry.find_name_add_show import add, open_case
from wakedeploy.gap.systems.gantry.findings import Leading, Ranked
from wakedeploy.gap.systems.gantry.flight import NotFlown, usable_flights
from wakedeploy.gap.systems.gantry.folder import read_steps, write
from wakedeploy.gap.systems.gantry.search.outcome import Thresholds
from wakedeploy.gap.systems.gantry.search.places import places_sentence
from wakedeploy.gap.systems.gantry.search.preliminary_ranking import UNSIMULATED
from wakedeploy.gap.systems.gantry.workflow import close, write_result
from wakedeploy.gap.wording import DETAILS
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.rig.file import read_rig

LIMITS = Thresholds(6.0, 8.0, 8.0, 60.0, 0.02, 0.02, 0.003)
HIDDEN = "crosswind-offset"
SECONDS = 8.0
SEARCHED = (HIDDEN, "coulomb-friction", "range-bias")
SCANNED = "pwm-dead-band"  # whose likelihood is jagged
CLAIMS = re.compile(r"missing from the model", re.IGNORECASE)


@pytest.fixture(autouse=True, scope="module")
def pictures_are_drawn_once() -> Iterator[None]:
    """Asked here are the words of the pages; that figures are drawn is asked of the report."""
    with drawing.each_drawn_once():
        yield


@pytest.fixture(scope="module")
def flights(tmp_path_factory) -> dict[str, list[Path]]:
    """Logs by what is hidden, and the rig file that knows nothing of it."""
    folder = tmp_path_factory.mktemp("flights")
    RIG.write(folder / "rig.toml")
    logs: dict[str, list[Path]] = {"rig": [folder / "rig.toml"]}
    hidden = with_effects(crosswind_offset={"offset_m": (0.15, "m")})
    for kind, truth, count in (("nothing", RIG, 1), (HIDDEN, hidden, 3)):
        logs[kind] = [folder / f"{kind}{i}.mcap" for i in range(count)]
        for i, path in enumerate(logs[kind]):
            log = record(truth, seconds=SECONDS, seed=60 + i, model_rig=RIG)
            log.without_truth().write_mcap(path)
    return logs


@contextlib.contextmanager
def searching(*names: str):
    """Few effects and no expression: the whole library and a search for one take a minute."""
    with pytest.MonkeyPatch.context() as patched:
        for module in ("preliminary_ranking", "naming"):
            patched.setattr(
                f"wakedeploy.gap.systems.gantry.search.{module}.LIBRARY",
                {n: LIBRARY[n] for n in names},
            )
        patched.setattr("wakedeploy.gap.systems.gantry.search.naming.search", lambda *_, **__: None)
        yield


def on_terminal(flights, kind: str, out: Path, *steps: str) -> str:
    given = ["--rig", str(flights["rig"][0]), "--measured", *map(str, flights[kind][:1])]
    runs = [CliRunner().invoke(main, ["gap", s, *given, "--out", str(out)]) for s in steps]
    assert [run.exit_code for run in runs] == [0] * len(steps), runs[-1].output
    return "\n".join(run.stdout for run in runs)


@pytest.fixture(scope="module")
def closed(flights, tmp_path_factory) -> dict[str, tuple[Path, str]]:
    """One flight each, closed on the command line: folder, and what the terminal said."""
    told = {}
    for kind in ("nothing", HIDDEN):
        out = tmp_path_factory.mktemp(kind)
        with searching(*SEARCHED, SCANNED):
            told[kind] = out, on_terminal(flights, kind, out, "close")
    return told


@pytest.fixture(scope="module")
def several(flights, tmp_path_factory) -> Callable[[int], tuple[Path, dict]]:
    """A function of so many flights with the effect: folder and result."""

    def closed_with(count: int) -> tuple[Path, dict]:
        out = tmp_path_factory.mktemp(f"{count}")
        logs = flights[HIDDEN][:count]
        with searching(*SEARCHED[:2]):
            result = close(flights["rig"][0], logs, out, report=False, thresholds=LIMITS)
        return out, result.as_json()

    return closed_with


def text_of(page: Path) -> str:
    """The words of a page, without style, tags and pictures."""
    hidden = r"<style.*?</style>|<title.*?</title>|<script.*?</script>"
    body = re.sub(hidden, "", page.read_text("utf-8"), flags=re.S)
    return html.unescape(re.sub(r"<[^>]*>", " ", body))


def squeezed(text: str) -> str:
    """Without spaces and what marks code, which are tags on a page."""
    return re.sub(r"[\s`]+", "", text)


def test_four_flights_are_the_fewest_that_leave_one_to_confirm() -> None:
    assert FEWEST_IN_ALL == 4
    assert FEWEST_IN_ALL - sealed_count(FEWEST_IN_ALL) == RULES.fewest_flights
    for count in range(1, 12):
        assert cannot_tell(count) is (count - sealed_count(count) < RULES.fewest_flights)
        assert unconfirmed(count) is (not cannot_tell(count) and sealed_count(count) == 0)
    assert [n for n in range(1, 12) if cannot_tell(n) or unconfirmed(n)] == [1, 2, 3]
    assert not cannot_tell(0)  # where nobody said how many there are


def test_what_the_project_flies_and_plans_itself_is_enough() -> None:
    assert min(demo.FULL.flights, demo.QUICK.flights) >= FEWEST_IN_ALL
    (option,) = [p for p in power.params if p.name == "flights"]
    assert option.type.min == FEWEST_IN_ALL  # written as a number there, which loads nothing


@pytest.mark.slow
def test_one_flight_of_a_rig_that_lacks_nothing_concludes_nothing(closed) -> None:
    out, told = closed["nothing"]
    page, result = text_of(out / "report.html"), json.loads((out / "result.json").read_text())
    assert told.startswith("Cannot tell from one flight: fly at least 4.\n")
    assert result["headline"] == "Cannot tell from one flight: fly at least 4."
    assert result["headline"] in page
    assert (result["verdict"], result["effects"], result["class"]) == ("inconclusive", [], [])
    assert result["unknown"] is None
    assert "No effect stands out" in told
    assert "In this one flight, no place stands out from noise." in page
    for words in (told, page):
        assert not CLAIMS.search(words)
        assert "gap add" not in words
        assert "would have shown" not in words
        assert " sure" not in words
    assert not (out / "rig.toml").exists()


@pytest.mark.slow
def test_the_advice_is_to_fly_with_seeds_that_no_log_has(flights, closed) -> None:
    out, told = closed["nothing"]
    rig, folder = flights["rig"][0], flights["nothing"][0].parent
    commands = json.loads((out / "result.json").read_text())["next"]["commands"]
    assert commands == [
        f"wakedeploy run-gantry --baseline --rig {rig} --virtual --seconds 20 --seed {seed} "
        f"--log {folder}"
        for seed in (61, 62, 63)
    ]
    for command in commands:
        assert command in told
        assert squeezed(command) in squeezed(text_of(out / "report.html"))
        options = {word for word in command.split() if word.startswith("--")}
        known = {name for p in main.get_command(None, "run-gantry").params for name in p.opts}
        assert options <= known


@pytest.mark.slow
def test_a_strong_effect_leads_on_one_flight_and_is_not_added(closed) -> None:
    out, told = closed[HIDDEN]
    leads = f"{HIDDEN} leads: it gains"
    lines = told.splitlines()
    assert lines[0] == "Cannot tell from one flight: fly at least 4."
    assert lines[1].startswith(leads)
    assert lines[1].endswith("One flight cannot confirm it.")
    assert f"If it is {HIDDEN}: offset" in told
    assert f"If it is {HIDDEN}: on the very flight that sizes were fitted to" in told
    page = text_of(out / "report.html")
    assert leads in page
    for words in (told, page):
        assert not CLAIMS.search(words)
        assert "gap add" not in words
        assert "placebo" not in words
    leading = json.loads((out / "result.json").read_text())["leading"]
    assert (leading["names"], leading["clear"]) == ([HIDDEN], True)
    assert leading["gain_nats"] > 20.0
    assert not (out / "rig.toml").exists()
    assert "Nothing: one flight cannot confirm what to add." in page


@pytest.mark.slow
def test_jagged_effects_are_tried_only_where_something_stands_out(closed) -> None:
    """Of hundreds of sizes of a dead band, some fit the noise of one flight."""
    for kind, tried in (("nothing", False), (HIDDEN, True)):
        named = json.loads((closed[kind][0] / "name.json").read_text())
        ranked = {entry["name"] for entry in named["rounds"][0]["ranking"]}
        assert ranked == {*SEARCHED} | ({SCANNED} if tried else set())
        assert (SCANNED in named["untried"]) is not tried


@pytest.mark.slow
def test_the_steps_by_themselves_say_the_same(flights, tmp_path) -> None:
    with searching(*SEARCHED):
        told = on_terminal(flights, "nothing", tmp_path, "find", "name", "show")
    headline = "Cannot tell from one flight: fly at least 4."
    assert told.count(headline) == 3
    assert told.count("Next: fly 3 more") == 3
    assert "In this one flight, no place stands out from noise." in told
    assert "Gain in this one flight, a nat per parameter taken off" in told
    assert "noise" not in told.split("height 0.25 s ahead: ")[-1].splitlines()[0]
    assert "gap add" not in told
    for more in ((), ("--from-symbolic",)):
        given = ["--rig", str(flights["rig"][0]), "--measured", str(flights["nothing"][0])]
        run = CliRunner().invoke(main, ["gap", "add", *given, "--out", str(tmp_path), *more])
        assert run.exit_code == 2
        assert f"nothing was concluded, none to add. {headline}" in run.stderr


@pytest.mark.slow
def test_an_effect_that_a_person_asks_for_is_added_with_a_caution(
    flights, closed, tmp_path
) -> None:
    for step in ("find", "name"):
        (tmp_path / f"{step}.json").write_bytes((closed[HIDDEN][0] / f"{step}.json").read_bytes())
    (tmp_path / "name.npz").write_bytes((closed[HIDDEN][0] / "name.npz").read_bytes())
    given = ["--rig", str(flights["rig"][0]), "--measured", str(flights[HIDDEN][0])]
    asked = ["gap", "add", *given, "--out", str(tmp_path), "--effect", HIDDEN]
    run = CliRunner().invoke(main, asked)
    assert run.exit_code == 0, run.output
    assert [e.name for e in read_rig(tmp_path / "rig.toml").effect] == [HIDDEN]
    caution = "One flight cannot confirm it: fly at least 4."
    assert caution in run.stdout
    assert caution in text_of(tmp_path / "report.html")


@pytest.mark.slow
def test_two_flights_conclude_no_more_than_one(several) -> None:
    out, told = several(2)
    assert told["headline"] == "Cannot tell from two flights: fly at least 4."
    assert told["verdict"] == "inconclusive"
    assert told["leading"]["names"] == [HIDDEN]
    assert len(told["next"]["commands"]) == 2
    words = account(read_steps(out).summary)
    assert "in these two flights" in words
    assert "Two flights cannot confirm it." in words
    assert f"If it is {HIDDEN}: on each flight, with sizes fitted to the others" in words
    assert not (out / "rig.toml").exists()


@pytest.mark.slow
def test_three_flights_name_and_a_fourth_has_to_confirm(flights, several) -> None:
    out, told = several(3)
    assert (told["verdict"], [e["name"] for e in told["effects"]]) == ("named", [HIDDEN])
    confirm = "Three flights say so; one more has to confirm it."
    assert told["headline"].startswith("Missing from the model: ")
    assert told["headline"].endswith(f"(`{HIDDEN}`). {confirm}")
    assert told["as_if"] == [HIDDEN]
    (command,) = told["next"]["commands"]
    assert "--seed 63" in command
    assert "the new one last, to be kept apart" in told["next"]["why"]
    assert not (out / "rig.toml").exists()
    assert "% sure" not in account(read_steps(out).summary)
    case = open_case(flights["rig"][0], flights[HIDDEN], thresholds=LIMITS)
    added = add(case, out)  # who asks for it gets it
    assert [e.name for e in added.effects] == [HIDDEN]


@pytest.mark.whole
def test_too_few_flights_do_not_wait_for_thresholds(flights, monkeypatch, tmp_path) -> None:
    """A rig file that nobody has simulated yet takes minutes, for nothing that could be said."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    other = RIG.changed(disturbance={"turbulence_fraction": 0.05})
    other.write(tmp_path / "rig.toml")

    def simulated(*_: object, **__: object) -> Thresholds:
        raise AssertionError("simulates")

    monkeypatch.setattr(
        "wakedeploy.gap.systems.gantry.find_name_add_show.thresholds_for", simulated
    )
    case = open_case(tmp_path / "rig.toml", flights[HIDDEN][:2])
    assert case.thresholds is UNSIMULATED
    assert not case.is_simulated
    with pytest.raises(AssertionError, match="simulates"):
        open_case(tmp_path / "rig.toml", flights[HIDDEN])


PLACES = {
    "none": [],
    "unclear": [{"channel": "force", "q_value": 0.04}],
    "innovation": [{"channel": "innovation", "q_value": 0.001}],
    "clear": [{"channel": "force", "q_value": 0.001}],
}
POSSIBLE = [
    (verdict, places, white)
    for verdict, places, white in itertools.product(
        ("named", "class", "unknown", "none"), PLACES, (True, False)
    )
    if not (verdict == "none" and places == "clear")  # which `naming` forbids
]


def fabricated(folder: Path, verdict: str, places: str, white: bool, count: int) -> None:
    """A folder as `close` leaves it; of too few flights an inconclusive one."""
    few = cannot_tell(count)
    fabricate(folder, verdict, maps=1, upto="name", flights=count)
    steps = read_steps(folder)
    assert steps.find is not None
    assert steps.find.white is not None
    assert steps.name is not None
    listed = [
        Place(**PLACE | place | {"words": f"height below 1: +0.1 N, q = {i}"})
        for i, place in enumerate(PLACES[places])
    ]
    sentence = places_sentence(listed, white, count - sealed_count(count))
    found = {"places": listed, "sentence": sentence}
    found["white"] = steps.find.white.model_copy(update={"passes": white})
    write(folder, steps.find.model_copy(update=found))
    named = steps.name
    if few:
        leading = Leading(clear=verdict != "none", names=["stiction"], gain_nats=30.0,
                          next="range-bias", next_nats=2.0)  # fmt: skip
        rounds = [
            searched.model_copy(update={"ranking": [unsure(each) for each in searched.ranking]})
            for searched in named.rounds
        ]
        nothing = {"verdict": "inconclusive", "effects": [], "rivals": [], "unknown": None}
        nothing |= {"leading": leading, "detectable": {}, "rounds": rounds}
        named = named.model_copy(update=nothing)
    write(folder, named)
    told = Result(verdict=named.verdict, effects=named.effects, rivals=named.rivals, flights=count)
    write_result(folder, told)


def unsure(entry: Ranked) -> Ranked:
    return entry.model_copy(update={"confidence": math.nan})


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7])
@pytest.mark.parametrize(("verdict", "places", "white"), POSSIBLE)
def test_headline_places_verdict_and_advice_never_contradict_each_other(
    tmp_path, verdict, places, white, count
) -> None:
    fabricated(tmp_path, verdict, places, white, count)
    steps = read_steps(tmp_path)
    headline, found = steps.result.headline, steps.find.sentence
    words = account(steps.summary)
    after = advice(steps, tmp_path)
    commands = " ".join(after.commands) if after else ""
    assert words.splitlines()[0] == headline
    if count < RULES.fewest_flights:
        flown = ("one flight", "two flights")[count - 1]
        assert headline == f"Cannot tell from {flown}: fly at least 4."
        assert not CLAIMS.search(words.replace("say that something is missing", ""))
        assert "As an expression" not in words
        assert found.startswith("In th")
    else:
        assert not headline.startswith("Cannot tell")
        assert ("Nothing is missing" in headline) is (verdict == "none")
        assert "t shows" in words or verdict == "none"
    # What no flight can confirm is never advised to be added.
    assert ("gap add" in commands) is (count >= FEWEST_IN_ALL and verdict in ("named", "unknown"))
    flies = count < RULES.fewest_flights or (count < FEWEST_IN_ALL and verdict != "none")
    assert commands.count("run-gantry") == (FEWEST_IN_ALL - count) * flies
    assert ("gap plan" in commands) is (verdict == "class" and count >= FEWEST_IN_ALL)
    # What `find` says can stand beside the verdict.
    if "disagree beyond noise" in found:
        assert "Nothing is missing" not in headline
    if verdict == "none" and count >= RULES.fewest_flights:
        assert "It shows most" not in words
        assert ("more than noise" in found) <= ("fitted anew" in words)


@pytest.mark.parametrize("count", [1, 3, 4])
@pytest.mark.parametrize("verdict", ["named", "class", "unknown", "none"])
def test_the_page_says_what_the_terminal_says(tmp_path, monkeypatch, verdict, count) -> None:
    if count >= RULES.fewest_flights:  # of fewer, captions could claim too much as well
        monkeypatch.setattr("wakedeploy.gap.report.page.PICTURES", ())
    fabricated(tmp_path, verdict, "none", True, count)
    page, steps = text_of(write_report(tmp_path)), read_steps(tmp_path)
    for sentence in account(steps.summary).splitlines():
        shown = sentence.removesuffix(":") if sentence == DETAILS else sentence  # a heading
        assert squeezed(shown) in squeezed(page)
    after = advice(steps, tmp_path)
    advised = "gap add" in " ".join(after.commands if after else ())
    assert ("gapadd" in squeezed(page)) is advised
    if count < RULES.fewest_flights:
        for word in ("confidence", " sure", "would have shown", "of the gap closed", "held out"):
            assert word not in page.replace("Nothing was held out", "")


def test_an_older_answer_about_one_flight_is_not_repeated() -> None:
    for verdict in ("named", "class", "unknown", "none"):
        told = account(
            summary({"verdict": verdict, "flights": 1, "effects": [{"name": "stiction"}]})
        )
        assert told == "Cannot tell from one flight: fly at least 4."


def test_what_chance_gives_is_said_to_be_unknown_before_it_is_simulated() -> None:
    leading = {"names": ["stiction"], "gain_nats": 4.0, "clear": False, "threshold_nats": None}
    told = account(summary({"verdict": "inconclusive", "flights": 1, "leading": leading}))
    assert "the best, stiction, gains 4.0 nats in this one flight; what chance alone gives" in told
    known = leading | {"threshold_nats": 6.5}
    told = account(summary({"verdict": "inconclusive", "flights": 1, "leading": known}))
    assert "gains 4.0 nats in this one flight; chance alone gives up to 6.5." in told


@pytest.mark.slow
def test_nothing_is_added_of_one_flight_unasked(flights, closed) -> None:
    case = open_case(flights["rig"][0], flights[HIDDEN][:1], thresholds=LIMITS)
    with pytest.raises(UnusableInput, match="Cannot tell from one flight"):
        add(case, closed[HIDDEN][0])


@pytest.mark.whole
def test_a_log_without_a_flight_is_left_out_and_said_to_be(flights, tmp_path) -> None:
    """A start that failed costs only its own log, at every step, in the account and the report."""
    short = tmp_path / "failed.mcap"
    record(RIG, seconds=5, seed=1).without_truth().write_mcap(short)
    (flown,) = flights["nothing"]
    given = ["--rig", str(flights["rig"][0]), "--measured", str(short), str(flown)]
    out = tmp_path / "out"
    with searching(*SEARCHED):
        runs = [
            CliRunner().invoke(main, ["gap", step, *given, "--out", str(out)])
            for step in ("find", "name")
        ]
    assert [run.exit_code for run in runs] == [0, 0], runs[-1].output
    sentence = "Left out: failed.mcap, only 3.6 s in the air"
    assert all(sentence in run.stderr for run in runs)
    found = json.loads((out / "find.json").read_text())
    assert [(log["path"], log["seed"]) for log in found["unflown"]] == [(str(short), 1)]
    assert found["split"]["fit"] == [log["path"] for log in found["logs"]] == [str(flown)]
    steps = read_steps(out)
    assert steps.flights == 1
    assert sentence in account(steps.summary)
    (row,) = (line for line in (out / "report.html").read_text().splitlines() if str(short) in line)
    assert "<td>left out</td>" in row


@pytest.mark.parametrize("ticks", [0, 17])
def test_a_log_of_a_few_ticks_is_left_out_beside_a_flight(flights, tmp_path, ticks: int) -> None:
    """A start that was refused, or that ended at once."""
    whole = record(RIG, seconds=5, seed=1).without_truth()
    few = dataclasses.replace(whole, columns={n: c[:ticks] for n, c in whole.columns.items()})
    few.write_mcap(tmp_path / "refused.mcap")
    (flown,) = flights["nothing"]
    kept, (left_out,) = usable_flights([tmp_path / "refused.mcap", flown], RIG)
    assert [flight.name for flight in kept] == [str(flown)]
    assert left_out.sentence.startswith(f"Left out: refused.mcap, it has only {ticks} ticks")


def test_logs_that_all_hold_no_flight_are_refused(flights, tmp_path) -> None:
    short, again = tmp_path / "failed.mcap", tmp_path / "again.mcap"
    for seed, path in enumerate((short, again), 1):
        record(RIG, seconds=5, seed=seed).without_truth().write_mcap(path)
    told = r"failed\.mcap: only 3.6 s in the air; .*, and 1 other log no flight either\."
    with pytest.raises(UnusableInput, match=told):
        open_case(flights["rig"][0], [short, again], thresholds=LIMITS)


def test_the_error_of_a_log_without_a_flight_comes_back_from_a_process() -> None:
    """As it was raised: exceptions are pickled on their way."""
    error = pickle.loads(pickle.dumps(NotFlown("a.mcap: it never flew.", "it never flew", 7)))
    assert (str(error), error.why, error.seed) == ("a.mcap: it never flew.", "it never flew", 7)


def test_a_failed_start_has_used_up_its_seed() -> None:
    logs = [Log(path="a", sha256="", seed=60)]
    assert Find(logs=logs, unflown=[Unflown(path="b", why="", seed=61)]).next_seed == 62
