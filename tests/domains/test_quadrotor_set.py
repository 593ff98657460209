"""FlareDW as an episode set: features, the observer that learns nothing, files split whole."""

from pathlib import Path

import needs
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wakedeploy.cli import main
from wakedeploy.core.episodes import read_episode_set
from wakedeploy.domains.quadrotor import OBSERVATION, features, import_set, observed_force
from wakedeploy.domains.quadrotor_files import LABEL_GRAVITY_MPS2, MASS_KG, thrust_n
from wakedeploy.study.domains import _by_group

HOVER_RADPS = 379.0


def states(seconds: float, seed: int, speed_radps: float = HOVER_RADPS) -> np.ndarray:
    """A vehicle that drifts about in some attitude, its quaternion and position consistent."""
    rng = np.random.default_rng(seed)
    n = int(seconds * 200)
    s = np.zeros((n, 26))
    time_s = np.arange(n) / 200
    s[:, 3:6] = np.cumsum(rng.normal(0, 0.01, (n, 3)), axis=0)
    s[:, 0:3] = rng.uniform(-1, 1, 3) + np.cumsum(s[:, 3:6], axis=0) / 200
    angles = 0.2 * np.sin(2.0 * time_s[:, None] + rng.uniform(0, 6, 3))
    x, y, z, w = Rotation.from_euler("ZYX", angles).as_quat().T
    s[:, 9:12], s[:, 18:22] = angles, np.stack([w, x, y, z], axis=1)
    s[:, 22:26] = speed_radps * np.array([1, 1, -1, -1])
    return s


def saved(folder: Path, name: str, seconds: float = 3.0, **overrides) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    keys = {"uav_1_states": states(seconds, 1), "uav_2_states": states(seconds, 2)} | overrides
    np.savez(folder / f"{name}.npz", **keys)
    return folder


@settings(max_examples=20, deadline=None)
@given(
    yaw=st.floats(-3.0, 3.0),
    shift=st.lists(st.floats(-50.0, 50.0), min_size=3, max_size=3),
    seed=st.integers(0, 1000),
)
def test_turning_and_moving_the_world_changes_no_feature(yaw, shift, seed) -> None:
    both = [states(1.0, seed), states(1.0, seed + 1)]
    turn = Rotation.from_euler("z", yaw)
    moved = []
    for s in both:
        m = s.copy()
        m[:, 0:3] = turn.apply(s[:, 0:3]) + shift
        m[:, 3:6] = turn.apply(s[:, 3:6])
        x, y, z, w = (turn * Rotation.from_quat(s[:, [19, 20, 21, 18]])).as_quat().T
        m[:, 18:22] = np.stack([w, x, y, z], axis=1)
        moved.append(m)
    assert features(*moved) == pytest.approx(features(*both), abs=1e-6)


def test_features_are_what_their_names_say() -> None:
    source, sufferer = states(1.0, 3), states(1.0, 4)
    source[:, 0:3], sufferer[:, 0:3] = (0.0, 0.0, 3.0), (0.3, 0.4, 1.0)
    source[:, 3:6], sufferer[:, 3:6] = (0.6, 0.8, 0.1), (-0.8, 0.6, -0.2)
    source[:, 18:22] = (1.0, 0.0, 0.0, 0.0)  # upright: no thrust sideways
    told = dict(zip([c.name for c in OBSERVATION], features(source, sufferer)[10], strict=True))
    assert told["distance_m"] == pytest.approx(0.5)
    assert told["dz_m"] == pytest.approx(-2.0)
    assert told["source_thrust_z_n"] == pytest.approx(thrust_n(source)[10])
    assert told["source_vz_mps"] == pytest.approx(0.1)
    assert (told["cos_source_thrust"], told["sin_source_thrust"]) == (0.0, 0.0)
    assert told["cos_source_velocity"] == pytest.approx(1.0)
    assert told["cos_sufferer_velocity"] == pytest.approx(0.0, abs=1e-12)
    assert told["sin_sufferer_velocity"] == pytest.approx(1.0)


def test_the_observer_sees_a_steady_push_and_nothing_of_the_future() -> None:
    push_n = np.array([0.5, -1.0, 2.0])
    s = states(2.0, 5)
    s[:, 18:22] = (1.0, 0.0, 0.0, 0.0)
    lift_n = np.array([0.0, 0.0, thrust_n(s)[0] - MASS_KG * LABEL_GRAVITY_MPS2])
    time_s = np.arange(len(s)) / 200
    s[:, 3:6] = time_s[:, None] * (push_n + lift_n) / MASS_KG
    assert observed_force(s) == pytest.approx(np.tile(push_n, (len(s), 1)), abs=0.02)
    later = s.copy()
    later[200:, 3:6] += 1.0
    assert np.array_equal(observed_force(later)[:200], observed_force(s)[:200])


def test_files_are_split_whole_within_each_manoeuvre(tmp_path: Path) -> None:
    for manoeuvre in ("1_flybelow", "3_swapping"):
        for number in range(4):
            two = states(6.0, 10 + number)
            two[600:, 0] += 1.0  # two iterations
            saved(tmp_path / manoeuvre / "some", f"run{number}", 6.0, uav_2_states=two)
    made = import_set(tmp_path)
    assert len(made.episodes) == 16
    for manoeuvre in ("1_flybelow", "3_swapping"):
        names = [n for n, m in made.provenance["manoeuvre"].items() if m == manoeuvre]
        assert len(names) == 8
        by_file: dict[str, set[str]] = {}
        for name in names:
            by_file.setdefault(name.rpartition("-")[0], set()).add(made.split[name])
        assert len(by_file) == 4
        assert all(len(splits) == 1 for splits in by_file.values())
        assert {made.split[n] for n in names} == {"train", "validation", "test"}


def test_samples_beyond_the_thrust_curve_are_marked_and_scored_apart(tmp_path: Path) -> None:
    for number in range(4):
        two = states(3.0, 20 + number)
        two[:, 22:26] = np.repeat([339.0, 385.0, 431.0], 200)[:, None] * [1, 1, -1, -1]
        saved(tmp_path / "1_flybelow", f"run{number}", uav_2_states=two)
    made = import_set(tmp_path)
    for episode in made.episodes:
        valid = episode.extras["thrust_valid"] > 0.5
        assert valid[200:400].all()
        assert not valid[:200].any()
        assert not valid[400:].any()
    (test,) = made.part("test")
    wrong = np.where(test.extras["thrust_valid"] > 0.5, 1.0, 9.0)[made.warm_up_steps :, None]
    told = _by_group(made, np.repeat(wrong, 3, axis=1), np.zeros(len(wrong)))
    assert told["where the thrust curve holds"] == (1.0, 1.0, 1.0)
    assert told["1_flybelow"][0] > 1.0


def plan(metres: float, samples: int = 600, lower_m: float = 0.0) -> np.ndarray:
    """Planned positions on the way to a place so far ahead."""
    planned = np.zeros((samples, 10))
    planned[:, 1] = metres * np.linspace(0.0, 1.0, samples) ** 2
    planned[:, 2] = -lower_m
    return planned


def test_flights_of_one_plan_are_one_course_in_one_split(tmp_path: Path) -> None:
    still = {"uav_1_planned_pos": plan(0.0)}
    for number, metres in enumerate((2.0, 3.0, 4.0)):
        for again in range(3):
            ahead = plan(metres, lower_m=0.5 * again)
            seen = states(3.0, 10 * number + again)
            saved(tmp_path / "1_flybelow", f"plan{number}{again}", uav_2_states=seen,
                  uav_2_planned_pos=ahead, **still)  # fmt: skip
    longer = np.vstack([plan(2.0), plan(2.0)[-1:]])
    saved(tmp_path / "1_flybelow", "plan0longer", uav_1_states=states(3.005, 1),
          uav_2_states=states(3.005, 50), uav_1_planned_pos=plan(0.0, 601),
          uav_2_planned_pos=longer)  # fmt: skip
    made = import_set(tmp_path)
    splits = {name: set() for name in ("plan0", "plan1", "plan2")}
    for name, split in made.split.items():
        splits[name.split("-")[1][:5]].add(split)
    assert all(len(own) == 1 for own in splits.values())
    assert set.union(*splits.values()) == {"train", "validation", "test"}
    assert splits["plan0"] == {"train"}  # the longest
    groups = made.provenance["groups"]
    assert len(set(groups.values())) == 3
    assert made.provenance["recordings"] == {
        "train": {"files": 4, "independent": 1},
        "validation": {"files": 3, "independent": 1},
        "test": {"files": 3, "independent": 1},
    }


def test_copies_of_a_file_are_one_course(tmp_path: Path) -> None:
    for folder in ("first", "second"):
        saved(tmp_path / "3_swapping" / folder, folder)
    saved(tmp_path / "3_swapping", "other", uav_2_states=states(3.0, 9))
    made = import_set(tmp_path)
    groups = made.provenance["groups"]
    assert groups["3_swapping-first-0"] == groups["3_swapping-second-0"]
    assert groups["3_swapping-other-0"] != groups["3_swapping-first-0"]


def test_the_command_writes_a_set_and_a_refusal_writes_nothing(tmp_path: Path) -> None:
    saved(tmp_path / "in" / "1_flybelow", "one")
    out = tmp_path / "set"
    told = CliRunner().invoke(main, ["data", "import", "quadrotor", str(tmp_path / "in"), "--out",
                                     str(out)])  # fmt: skip
    assert told.exit_code == 0, told.output
    assert read_episode_set(out).domain == "quadrotor"
    assert "independent" in told.output
    empty = tmp_path / "empty"
    empty.mkdir()
    refused = CliRunner().invoke(main, ["data", "import", "quadrotor", str(empty), "--out",
                                        str(tmp_path / "none")])  # fmt: skip
    assert refused.exit_code == 2
    assert "no .npz" in refused.output
    assert not (tmp_path / "none").exists()


@needs.recordings("quadrotor")
def test_no_two_splits_of_the_recordings_share_a_plan() -> None:
    made = import_set(needs.DATA / "quadrotor")
    planned = list[tuple[str, np.ndarray]]()
    seen = dict[str, set[str]]()
    for file in sorted((needs.DATA / "quadrotor").rglob("*.npz")):
        manoeuvre = file.relative_to(needs.DATA / "quadrotor").parts[0]
        own = {s for n, s in made.split.items()
               if n.rpartition("-")[0] == f"{manoeuvre}-{file.stem}"}  # fmt: skip
        assert len(own) == 1
        seen.setdefault(manoeuvre, set()).update(own)
        with np.load(file) as archive:
            if "uav_2_planned_pos" in archive:
                planned.append((*own, archive["uav_2_planned_pos"][:, :3]))
    assert len(planned) >= 10
    for split, one in planned:
        for other_split, other in planned:
            n = min(len(one), len(other))
            # Horizontally, so that the same approach at another height is the same.
            apart_m = np.linalg.norm(one[:n, :2] - other[:n, :2], axis=1).max()
            assert split == other_split or apart_m > 0.1
    assert seen["1_flybelow"] == seen["3_swapping"] == {"train", "validation", "test"}
    assert seen["2_flyabove"] >= {"train", "test"}


@needs.recordings("quadrotor")
def test_the_recordings_become_a_set() -> None:
    made = import_set(needs.DATA / "quadrotor")
    seconds = sum(len(e.force) for e in made.episodes) / made.rate_hz
    assert seconds > 120.0
    test = made.part("test")
    force = np.concatenate([e.force[:, 2] for e in test])
    observed = np.concatenate([e.extras["observer_n"][:, 2] for e in test])
    # The sufferer's own motion tells much of the label, which is made of its acceleration.
    assert np.sqrt(np.mean((observed - force) ** 2)) < 0.7 * np.sqrt(np.mean(force**2))


def test_the_corrected_label_has_the_term_of_turning_axes_again(tmp_path: Path) -> None:
    """F = m(v̇ + ω × v) − thrust + weight: given back to the label, in world axes."""
    turning = states(6.0, 1)
    turning[:, 18:22] = (1.0, 0.0, 0.0, 0.0)
    turning[:, 12:15], turning[:, 3:6] = (0.0, 0.0, 2.0), (1.0, 0.0, 0.0)
    turning[:, 0:3] = np.arange(len(turning))[:, None] / 200 * turning[:, 3:6]
    saved(tmp_path / "3_swapping" / "some", "run", 6.0, uav_2_states=turning)
    plain, mended = (import_set(tmp_path, label=one) for one in ("authors", "corrected"))
    for one, other in zip(plain.episodes, mended.episodes, strict=True):
        given_back = other.force - one.force
        assert given_back == pytest.approx(np.tile([0.0, 2.0 * MASS_KG, 0.0], (len(given_back), 1)))
        assert np.array_equal(one.extras["observer_n"], other.extras["observer_n"])
    assert mended.provenance["label"] == "corrected"
