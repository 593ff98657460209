"""The demo: its story is drawn from whatever the steps left, and it finds what was hidden."""

import json

import matplotlib.image
import numpy as np
import pytest
from click.testing import CliRunner
from fabricated_artefacts import fabricate

from wakedeploy.cli.gap_demo import demo
from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap import demo as story
from wakedeploy.gap.report.demo_figure import Flown, draw_story
from wakedeploy.gap.systems.gantry.folder import read_steps
from wakedeploy.gap.systems.gantry.retraining import EitherRig, FlownAgain, TrackingError
from wakedeploy.physics.effects.chain import Chain
from wakedeploy.rig.file import read_rig


def tracking(after=6.1):
    def error(rmse):
        return TrackingError(rmse, None, None, [rmse])

    pid, feedforward = (
        EitherRig(error(one), error(other)) for one, other in ((47.0, 46.0), (10.4, after))
    )
    return FlownAgain("mm", 20.0, [1], pid, feedforward)


def flown():
    at_s = np.arange(0.0, 20.0, 1 / 32)
    return Flown(at_s, 10.0 * np.sin(at_s))


@pytest.mark.parametrize("places", [True, False])
def test_the_story_is_one_picture_wide_enough_to_read(tmp_path, places):
    fabricate(tmp_path)
    if not places:
        found = json.loads((tmp_path / "find.json").read_text("utf-8"))
        (tmp_path / "find.json").write_text(json.dumps(found | {"places": []}), "utf-8")
    picture = tmp_path / "story.png"
    draw_story(read_steps(tmp_path), tracking(), flown(), flown(), story.hidden_values(), picture)
    height, width, _ = matplotlib.image.imread(picture).shape
    assert 1100 < width < 1800
    assert 0.5 < height / width < 0.8


def test_a_flight_that_a_failsafe_ended_is_said_so(tmp_path):
    fabricate(tmp_path)
    draw_story(read_steps(tmp_path), tracking(None), flown(), flown(), {}, tmp_path / "story.png")
    assert (tmp_path / "story.png").stat().st_size > 10_000


def test_the_rig_file_lacks_exactly_what_the_gantry_has():
    world, believed = story.world_rig(), story.believed_rig()
    assert believed.spool.source.up_s == believed.spool.sufferer.down_s == 0.0
    assert believed.changed(spool=world.spool.model_dump()) == world
    assert story.hidden_values() == {
        "spool-lag-source.up_s": 0.06,
        "spool-lag-source.down_s": 0.1,
        "spool-lag-sufferer.up_s": 0.06,
        "spool-lag-sufferer.down_s": 0.1,
    }


@pytest.mark.whole
def test_measured_flights_know_nothing_of_the_truth(tmp_path):
    from wakedeploy.core.runlog import read_run_log

    size = story.Size(flights=1, seconds=8.0, minutes=1.0, epochs=1, test_flights=1)
    path = tmp_path / "flight1.mcap"
    story.fly_measured([path], size, workers=1)
    log = read_run_log(path)
    assert not [name for name in log.columns if name.startswith("true_")]
    assert log.metadata["rig_sha256"] == story.believed_rig().sha256


@pytest.mark.parametrize(
    ("named", "after", "ok"),
    [
        (["spool-lag-source", "spool-lag-sufferer"], 6.0, True),
        (["spool-lag-sufferer"], 6.0, False),
        (["spool-lag-source", "spool-lag-sufferer"], 11.0, False),
        (["spool-lag-source", "spool-lag-sufferer"], None, False),
    ],
)
def test_the_demo_says_when_it_did_not_show_what_it_should(tmp_path, monkeypatch, named, after, ok):
    fabricate(tmp_path / "gap")
    steps = read_steps(tmp_path / "gap")
    effects = [steps.name.effects[0].model_copy(update={"name": name}) for name in named]
    told = story.Story("named", effects, tracking(after), tmp_path / "x.png", 1.0)
    (tmp_path / "x.png").write_bytes(b"picture")
    story.believed_rig().write(tmp_path / "gap" / "rig.toml")
    monkeypatch.setattr(story, "run", lambda *_, **__: told)
    done = CliRunner().invoke(
        demo, ["--out", str(tmp_path), "--figures", str(tmp_path / "figures")]
    )
    assert (done.exception is None) == ok, done.output
    assert json.loads((tmp_path / "demo.json").read_text("utf-8"))["ok"] == ok
    assert (tmp_path / "figures" / story.PICTURE).read_bytes() == b"picture"
    assert "47.0 mm" in done.output


def test_the_demo_replaces_nobodys_rig_file_or_flights(tmp_path, monkeypatch):
    monkeypatch.setattr(story, "fly_measured", lambda *_: pytest.fail("flew"))
    for name, content in (("rig.toml", "# mine\n"), ("flight1.mcap", "mine")):
        folder = tmp_path / name
        folder.mkdir()
        (folder / name).write_text(content, "utf-8")
        with pytest.raises(UnusableInput, match=f"{name}: not the demo's"):
            story.run(folder)
        assert [p.read_text("utf-8") for p in folder.iterdir()] == [content]
    story.believed_rig().write(tmp_path / "flight1.mcap" / "rig.toml")  # as an earlier demo left it
    with pytest.raises(pytest.fail.Exception, match="flew"):
        story.run(tmp_path / "flight1.mcap")


@pytest.mark.slow
def test_the_whole_story_in_short(tmp_path):
    told = story.run(tmp_path, story.QUICK)
    assert told.ok, told
    found = read_rig(tmp_path / "gap" / "rig.toml")
    for name, hidden in story.hidden_values().items():
        assert Chain.of(found).values[name] == pytest.approx(hidden, abs=0.02)
    assert "spool-lag-source" in story.effect_lines(tmp_path / "gap" / "rig.toml")
    assert (tmp_path / "gap" / "report.html").exists()
    assert (tmp_path / story.PICTURE).stat().st_size > 20_000
