"""The eight cores: Table I's counts, the budget, and streams that agree with whole sequences."""

import contextlib

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from trainers.build import ARCHITECTURES, build
from trainers.model import Predictor, StateModel
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.manifest import PARAMETER_BUDGET

TABLE_I = {
    "agile-mlp": 17_922,
    "history-mlp": 48_642,
    "delay-embedding": 35_014,
    "gru": 70_882,
    "tcn": 72_602,
    "mamba": 8_802,
    "esn": 2_002,
    "cross-attention": 15_522,
}
STATEFUL = ["gru", "tcn", "mamba", "esn"]
SMALL_RESERVOIR = {"esn": {"neurons": 60}}


def core(arch: str, inputs: int = 8, outputs: int = 2, seed: int = 0, **hyper: object):
    values = {**SMALL_RESERVOIR.get(arch, {}), **hyper}
    return build(
        arch,
        inputs=inputs,
        outputs=outputs,
        window_s=1.0,
        rate_hz=30.0,
        hyper=values,
        seed=seed,
    )


def predictor(arch: str, inputs: int = 3, outputs: int = 2, seed: int = 0) -> Predictor:
    made = Predictor(arch, core(arch, inputs, outputs, seed), inputs, outputs)
    made.set_normalisation(
        5 + 3 * torch.randn(200, inputs), torch.linspace(-2, 9, 200)[:, None].repeat(1, outputs)
    )
    return made.eval()


@pytest.mark.parametrize(("arch", "count"), TABLE_I.items())
def test_trainable_counts_are_those_of_table_1(arch: str, count: int) -> None:
    built = build(arch, inputs=8, outputs=2, window_s=1.0, rate_hz=30.0)
    assert built.trainable == count
    assert built.frozen == (1_008_000 if arch == "esn" else 0)


def test_the_papers_eight_architectures_are_there() -> None:
    assert len(TABLE_I) == 8
    assert set(ARCHITECTURES) >= set(TABLE_I)


@pytest.mark.parametrize(
    ("arch", "hyper"),
    [("gru", {"hidden": 200}), ("agile-mlp", {"layers": 9}), ("tcn", {"kernel": 6})],
)
def test_a_model_beyond_the_budget_is_refused_with_both_numbers(arch: str, hyper: dict) -> None:
    with pytest.raises(UnusableInput, match=r"\d{3},\d{3} trainable.* 100,000"):
        core(arch, **hyper)


def test_the_budget_itself_is_already_too_much() -> None:
    # 99,999 = (d + 2)·h + 1 weights of one hidden layer with one output; d = 2 has 4·h + 1.
    assert core("agile-mlp", 2, 1, layers=1, hidden=24_999).trainable == PARAMETER_BUDGET - 3
    with pytest.raises(UnusableInput, match="100,001"):
        core("agile-mlp", 2, 1, layers=1, hidden=25_000)


@pytest.mark.parametrize(
    ("arch", "hyper", "says"),
    [
        ("gru", {"hiden": 3}, "no hyper-parameter 'hiden'; it has projection, hidden"),
        ("gru", {"hidden": 0}, "hidden = 0 has to be a whole number from 1 to"),
        ("gru", {"hidden": 2.5}, "whole number"),
        ("gru", {"hidden": True}, "whole number"),
        ("gru", {"hidden": 10**12}, "from 1 to"),
        ("gru", {"dropout": 2}, "dropout = 2 has to be a number from 0 to 0.9"),
        ("esn", {"leak": float("nan")}, "from 0.001 to 1"),
        ("esn", {"leak": "fast"}, "from 0.001 to 1"),
        ("esn", {"density": 0}, "from 0.001 to 1"),
        ("esn", {"neurons": 2, "density": 0.001}, "without a loop"),
        ("tcn", {"kernel": 1}, "from 2 to"),
        ("tcn", {"blocks": 60, "channels": 1}, "from 1 to 12"),
        ("mamba", {"d_conv": 1}, "from 2 to"),
        ("cross-attention", {"heads": 5}, "embed = 32 with heads = 5 .* a multiple of 10"),
        ("cross-attention", {"embed": 33}, "a multiple of 4"),
        ("cross-attention", {"embed": 5, "heads": 5}, "a multiple of 10"),
        ("mlp", {}, "choose agile-mlp, history-mlp"),
    ],
)
def test_unusable_names_and_values_are_told(arch: str, hyper: dict, says: str) -> None:
    with pytest.raises(UnusableInput, match=says):
        core(arch, **hyper)


WHOLE = [
    (arch, name)
    for arch, known in ARCHITECTURES.items()
    for name, default in vars(known.hyper()).items()
    if isinstance(default, int)
]
FRACTIONS = [
    (arch, name)
    for arch, known in ARCHITECTURES.items()
    for name, default in vars(known.hyper()).items()
    if not isinstance(default, int)
]

IMPOSSIBLE = {
    ("tcn", "kernel"): {1, 6},  # 6 is beyond the budget
    ("mamba", "d_conv"): {1},
    ("cross-attention", "heads"): {3, 5, 6},
    ("cross-attention", "embed"): {1, 2, 3, 5, 6},
}


@torch.no_grad()
def fed_one_by_one(made: Predictor, observations: torch.Tensor) -> torch.Tensor:
    """Forces (T, o) for (T, d), from one call of `step` for each sample, as the loop calls it."""
    memory, state, forces = made.memory, made.initial_state(1), []
    for t in range(len(observations)):
        if memory.kind == "state":
            force, state = made.step(observations[t : t + 1], state)
        elif memory.kind == "window":
            seen = [observations[max(0, t - age * memory.stride)] for age in range(memory.k)]
            force = made.step(torch.stack(seen[::-1])[None])
        else:
            force = made.step(observations[t : t + 1])
        forces.append(force[0])
    return torch.stack(forces)


def assert_usable(arch: str, hyper: dict) -> None:
    values = {**SMALL_RESERVOIR.get(arch, {}), **hyper}
    built = build(arch, inputs=3, outputs=2, window_s=0.5, rate_hz=20.0, hyper=values)
    made = Predictor(arch, built, 3, 2).eval()
    observations = torch.randn(30, 3, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        whole = made.rollout(observations[None])[0]
    assert whole.isfinite().all()
    torch.testing.assert_close(fed_one_by_one(made, observations), whole, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize(("arch", "name"), WHOLE)
def test_any_small_count_is_refused_in_words_or_streams_as_it_rolls_out(
    arch: str, name: str
) -> None:
    refused = set()
    for value in range(1, 7):
        try:
            assert_usable(arch, {name: value})
        except UnusableInput:
            refused.add(value)
    if arch == "esn":  # a reservoir this small has a loop by chance
        assert len(refused) < 6
    else:
        assert refused == IMPOSSIBLE.get((arch, name), set())


@pytest.mark.parametrize(("arch", "name"), FRACTIONS)
@settings(max_examples=12, deadline=None)
@given(value=st.one_of(st.floats(), st.floats(-1, 3), st.sampled_from([0, 1, 2, 0.9, 0.001])))
def test_any_number_is_refused_in_words_or_gives_finite_forces(
    arch: str, name: str, value: float
) -> None:
    with contextlib.suppress(UnusableInput):
        assert_usable(arch, {name: value})


@pytest.mark.parametrize("arch", TABLE_I)
def test_weights_follow_the_seed_and_leave_torchs_own_generator_alone(arch: str) -> None:
    before = torch.get_rng_state()
    first, same, other = (core(arch, seed=s).state_dict() for s in (1, 1, 2))
    assert torch.equal(before, torch.get_rng_state())
    assert all(torch.equal(first[name], same[name]) for name in first)
    assert any(not torch.equal(first[name], other[name]) for name in first)


@pytest.mark.parametrize("arch", STATEFUL)
@torch.no_grad()
def test_step_by_step_equals_the_whole_sequence(arch: str) -> None:
    torch.manual_seed(1)
    made, observations = predictor(arch), 5 + 3 * torch.randn(2, 120, 3)
    whole, state, stepped = made.rollout(observations), made.initial_state(2), []
    for observation in observations.unbind(1):
        force, state = made.step(observation, state)
        stepped.append(force)
    torch.testing.assert_close(torch.stack(stepped, 1), whole, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("arch", STATEFUL)
@settings(max_examples=8, deadline=None)
@given(cut=st.integers(1, 49), seed=st.integers(0, 99))
@torch.no_grad()
def test_a_sequence_may_be_cut_anywhere(arch: str, cut: int, seed: int) -> None:
    made = predictor(arch, seed=seed)
    observations = 5 + 3 * torch.randn(2, 50, 3, generator=torch.Generator().manual_seed(seed))
    head, state = made.advance(observations[:, :cut], made.initial_state(2))
    tail, _ = made.advance(observations[:, cut:], state)
    whole = made.rollout(observations)
    torch.testing.assert_close(torch.cat([head, tail], 1), whole, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("arch", TABLE_I)
@torch.no_grad()
def test_no_prediction_depends_on_the_future(arch: str) -> None:
    made, observations = predictor(arch), torch.randn(1, 80, 3)
    changed = observations.clone()
    changed[:, 50:] += 100
    before, after = made.rollout(observations), made.rollout(changed)
    torch.testing.assert_close(before[:, :50], after[:, :50])
    assert not torch.allclose(before[:, 50:], after[:, 50:])


@pytest.mark.parametrize("arch", STATEFUL)
def test_states_are_as_declared(arch: str) -> None:
    made = core(arch)
    assert isinstance(made, StateModel)
    _, state = made.step(torch.zeros(3, 8), made.initial_state(3))
    assert {n: tuple(v.shape[1:]) for n, v in state.items()} == made.memory.states


def test_the_tcn_keeps_378_frames_and_sees_379_samples() -> None:
    made = core("tcn")
    assert sum(shape[1] for shape in made.memory.states.values()) == 378
    observations = torch.randn(1, 500, 8, requires_grad=True)
    made(observations)[0][0, -1].sum().backward()
    seen = observations.grad[0].abs().sum(1) > 0
    assert not seen[: 500 - 379].any()
    assert seen[500 - 379 :].sum() > 300  # a few samples may hit only inactive units


@torch.no_grad()
def test_attention_sums_to_one_over_the_window() -> None:
    made = core("cross-attention")
    _, weights = made.attend(torch.randn(5, 31, 8))
    assert weights.shape == (5, 4, 31)
    torch.testing.assert_close(weights.sum(2), torch.ones(5, 4))


@torch.no_grad()
def test_the_delay_starts_where_it_is_told_and_the_gap_is_masked() -> None:
    made = core("delay-embedding", initial_delay_s=0.4, initial_spread_s=0.05, gap_s=0.25)
    window = torch.randn(3, 31, 8)
    delay_s, spread_s = made.kernel(window)
    torch.testing.assert_close(delay_s, torch.full((3, 1), 0.4))
    torch.testing.assert_close(spread_s, torch.full((3, 1), 0.05))
    changed = window.clone()
    changed[:, -8:-1] += 50  # ages 1/30 … 7/30 s lie inside the gap; the newest is always seen
    torch.testing.assert_close(made(window), made(changed))
    changed[:, -9] += 50
    assert not torch.allclose(made(window), made(changed))


def test_the_delay_starts_at_half_the_window_by_default() -> None:
    assert core("delay-embedding").delay_s.item() == pytest.approx(0.5)


@pytest.mark.parametrize("towards", [-1.0, 1.0])
def test_a_kernel_however_narrow_or_wide_has_forces_and_gradients(towards: float) -> None:
    made = core("delay-embedding")
    window = torch.randn(3, 31, 8)
    with torch.no_grad():
        made.log_spread.copy_(torch.tensor(1000.0 * towards))
    made(window).sum().backward()
    assert all(p.grad.isfinite().all() for p in made.parameters())
    with torch.no_grad():
        weights = made.weigh(*made.kernel(window))
        alike = torch.full_like(weights, 1 / weights.shape[1])
        if towards > 0:
            torch.testing.assert_close(weights, alike, rtol=1e-3, atol=0.0)
        else:
            torch.testing.assert_close(weights.amax(1), torch.ones(3), rtol=0.0, atol=0.1)


@pytest.mark.parametrize("arch", TABLE_I)
def test_windows_of_every_domain_are_taken(arch: str) -> None:
    for window_s, rate_hz in ((0.5, 30.0), (0.02, 32.0), (1.0, 200.0)):
        built = build(
            arch,
            inputs=3,
            outputs=1,
            window_s=window_s,
            rate_hz=rate_hz,
            hyper=SMALL_RESERVOIR.get(arch),
        )
        assert Predictor(arch, built, 3, 1).rollout(torch.randn(1, 40, 3)).isfinite().all()


def test_a_channel_that_never_moves_is_no_division_by_zero() -> None:
    made = Predictor("agile-mlp", core("agile-mlp", 2, 1), 2, 1)
    still = torch.tensor([[0.1, 1.0], [0.1, 2.0]]).repeat(50, 1)
    made.set_normalisation(still, torch.full((100, 1), 0.3))
    assert made.observation_sd[0] == 1
    assert made.rollout(still[None]).isfinite().all()
