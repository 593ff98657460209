"""Effects that act in a place: a stop far from zero, a jet of some width that the user wrote."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.ranking import Candidate
from wakedeploy.gap.search.judging import fitted_base
from wakedeploy.gap.search.scan import ranked
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.correction import (
    correction_of,
    read_correction,
    write_correction,
)
from wakedeploy.gap.systems.kinds.forces import At, LowerStop
from wakedeploy.gap.systems.likelihood.augmented import BUMPS, FORM_MOST, Acting
from wakedeploy.gap.systems.likelihood.logs import LogModel

RATE = 50.0
MASS_KG = 2.0


def blown(t, state, inputs, p):
    """A jet across the rail at 5.5 m."""
    return {"speed_mps": p.strength * np.exp(-(((state.position_m - 5.5) / p.width_m) ** 2))}


class Carriage(System):
    """A mass on a rail that begins five metres away, known but for what acts in places."""

    rate_hz = RATE
    inputs: ClassVar = [Input("force_n", "N")]
    states: ClassVar = {"position_m": "m", "speed_mps": "m/s"}
    outputs: ClassVar = [Output("position_m", "m", noise=1e-3)]
    constants: ClassVar = [Constant("mass_kg", MASS_KG), Constant("drag_nspm", 4.0)]
    ports: ClassVar = [
        Port.force("speed_mps", inertia="mass_kg", position="position_m"),
        Port.custom("jet", blown, {"strength": ("m/s²", 1.0)}, {"width_m": ("m", 0.3)}),
    ]

    def derivative(self, state, inputs, c):
        pull = inputs.force_n - c.drag_nspm * state.speed_mps
        return {"position_m": state.speed_mps, "speed_mps": pull / c.mass_kg}


def recorded(force) -> Recording:
    """Thirty seconds in fine steps, with `force(position_m, speed_mps)` [N] beside what pushes."""
    rng = np.random.default_rng(3)
    pushed = np.repeat(rng.uniform(-6.0, 6.0, 60), 25)
    x, v, shown = 5.5, 0.0, np.empty(len(pushed))
    for k, push in enumerate(pushed):
        pushed[k] = push = push + 12.0 * (5.5 - x)  # a spring that is logged keeps it near
        shown[k] = x + 1e-3 * rng.standard_normal()
        for _ in range(20):
            v += (push - 4.0 * v + force(x, v)) / MASS_KG / RATE / 20
            x += v / RATE / 20
    columns = {"force_n": pushed, "position_m": shown}
    return Recording("carriage", np.arange(len(pushed)) / RATE, columns)


def leading(force) -> Candidate:
    model, told = LogModel(Carriage(), [recorded(force)]), list[tuple[int, int]]()
    names = list(model.effects)
    best = ranked(model, fitted_base(model), names, lambda *at: told.append(at))[0][0]
    # What takes longest, the climbs, is told in parts as well.
    assert told == sorted(told)
    assert {total for _, total in told} == {told[-1][0]}
    assert any(len(names) < done < total for done, total in told)
    return best


@pytest.mark.slow
@pytest.mark.parametrize("loss_spm", [0.0, pytest.param(3.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("kind", "limit_m", "sign"),
    [pytest.param("lower", 5.2, 1.0, marks=pytest.mark.slow), ("upper", 5.8, -1.0)],
)
def test_a_stop_is_found_wherever_the_way_ends(kind, limit_m, sign, loss_spm):
    """It throws back, or takes speed away, and never holds what leaves."""

    def met(x, v):
        pressed = max(sign * (limit_m - x), 0.0)
        return sign * 200.0 * pressed * max(1.0 - loss_spm * sign * v, 0.0)

    name = f"{kind}-stop@speed_mps"
    best = leading(met)
    assert best.name == name
    assert best.fit.value(f"{name}.limit") == pytest.approx(limit_m, abs=0.01)
    assert best.fit.value(f"{name}.stiffness") == pytest.approx(200.0, rel=0.3)
    low, high = best.fit.interval(f"{name}.loss")
    assert low - 0.3 < loss_spm < high + 0.3
    assert high - low < 3.0


def test_a_force_that_is_gone_through_is_no_stop():
    """As air holds up what is near the floor: over a third of the way, and softly."""
    model = LogModel(Carriage(), [recorded(lambda x, v: 8.0 * np.exp(-(x - 5.0) / 0.15))])
    low, high = (model.sizes[f"{end} position_m"] for end in ("lowest", "highest"))
    (limit,) = (f for f in model.free(("lower-stop@speed_mps",)) if f.name.endswith(".limit"))
    assert limit.high == pytest.approx(low + 0.1 * (high - low))
    assert all(limit.low < start <= limit.high for start in limit.starts)
    (limit,) = (f for f in model.free(("upper-stop@speed_mps",)) if f.name.endswith(".limit"))
    assert limit.low == pytest.approx(high - 0.1 * (high - low))


@pytest.mark.parametrize("stiffness", [10.0, 100.0, 3000.0])
def test_a_stop_bears_a_force_within_it_and_none_from_afar(stiffness):
    """In usual forces over the length of the way; the stiffer, the less it gives."""
    sizes = {"range": 1.0, "force": 1.0, "speed": 1.0}

    def borne(position):
        at = At(*np.full((5, 1), 0.0), own_states=(), sizes=sizes)
        values = {"stiffness": stiffness, "limit": 0.0, "loss": 0.0}
        return LowerStop().force(replace(at, position=np.array([position])), values)[0]

    assert borne(-2.0 / stiffness) == pytest.approx(2.0, rel=0.15)
    assert borne(0.1) < 0.05
    assert borne(0.5) < 0.01


def test_a_state_that_another_moves_is_no_speed_of_it():
    """Two tanks, one above the other: a port may name the other's level as its position."""

    class Tanks(Carriage):
        states: ClassVar = {"position_m": "m", "speed_mps": "m/s", "level_m": "m"}
        ports: ClassVar = [Port.force("level_m", position="position_m")]

        def derivative(self, state, inputs, c):
            rates = super().derivative(state, inputs, c)
            return {**rates, "level_m": state.position_m - state.level_m}

    model = LogModel(Tanks(), [recorded(lambda x, v: 0.0)])
    names = [f.name for f in model.free(("lower-stop@level_m",))]
    assert not any(name.endswith(".loss") for name in names)


def test_a_stop_of_a_discrete_system_takes_speed_away_too():
    class Stepped(System):
        rate_hz = RATE
        inputs: ClassVar = Carriage.inputs
        states: ClassVar = Carriage.states
        outputs: ClassVar = Carriage.outputs
        constants: ClassVar = Carriage.constants
        ports: ClassVar = [Port.force("speed_mps", inertia="mass_kg", position="position_m")]

        def step(self, state, inputs, c):
            pull = inputs.force_n - c.drag_nspm * state.speed_mps
            return {
                "position_m": state.position_m + state.speed_mps / RATE,
                "speed_mps": state.speed_mps + pull / c.mass_kg / RATE,
            }

    model = LogModel(Stepped(), [recorded(lambda x, v: 0.0)])
    assert any(f.name == "lower-stop@speed_mps.loss" for f in model.free(("lower-stop@speed_mps",)))


def test_what_ends_a_level_takes_no_speed_away():
    """A rim acts on the level itself: nothing there has a speed."""

    class Tank(Carriage):
        states: ClassVar = {"level_m": "m"}
        outputs: ClassVar = [Output("level_m", "m", noise=1e-3)]
        ports: ClassVar = [Port.force("level_m", position="level_m")]

        def derivative(self, state, inputs, c):
            return {"level_m": inputs.force_n / c.mass_kg - state.level_m}

    rng = np.random.default_rng(0)
    columns = {"force_n": rng.uniform(0.0, 3.0, 300), "level_m": rng.uniform(0.4, 0.6, 300)}
    model = LogModel(Tank(), [Recording("tank", np.arange(300) / RATE, columns)])
    of_a_stop = [f.name for f in model.free(("upper-stop@level_m",)) if "stop" in f.name]
    assert of_a_stop == ["upper-stop@level_m.stiffness", "upper-stop@level_m.limit"]


@pytest.mark.slow
@pytest.mark.parametrize("width_m", [0.1, 0.8])
def test_an_effect_of_the_user_s_own_has_a_shape_beside_its_size(width_m):
    best = leading(lambda x, v: -2.0 * MASS_KG * np.exp(-(((x - 5.5) / width_m) ** 2)))
    assert best.name == "jet"
    assert best.fit.value("jet.strength") == pytest.approx(-2.0, rel=0.1)
    assert best.fit.value("jet.width_m") == pytest.approx(width_m, rel=0.1)


SIZE, WIDTH = {"strength": ("m/s²", 1.0)}, {"width_m": ("m", 0.3)}


@pytest.mark.parametrize(
    ("function", "parameters", "shapes", "told"),
    [
        (blown, SIZE, {"strength": ("m", 0.3)}, "'strength' as a parameter and as a shape"),
        (blown, SIZE, {"width_m": ("m", 0.0)}, "'width_m' of the effect 'jet'"),
        (blown, SIZE, {"width_m": ("m", float("nan"))}, "'width_m' of the effect 'jet'"),
        (blown, SIZE, {"width_m": ("m", "wide")}, "give a positive number"),
        (blown, {}, WIDTH, "no parameter at which it vanishes"),
        (blown, SIZE, {}, "parameter 'width_m' is not there"),
        (lambda t, state, inputs, p: {"height_m": p.strength}, SIZE, WIDTH, "'height_m', no state"),
        (lambda t, state, inputs, p: {"speed_mps": 1.0}, SIZE, WIDTH, "has to vanish there"),
        (lambda t, state, inputs, p: {"speed_mps": np.log(-p.strength)}, SIZE, {}, "no number"),
        (lambda t, state, inputs, p: {"speed_mps": np.ones(2)}, SIZE, {}, "the shape"),
        (lambda t, state, inputs, p: p.strength, SIZE, {}, "return a dict"),
    ],
)
def test_an_effect_of_the_user_s_own_that_cannot_act_is_refused(function, parameters, shapes, told):
    port = Port.custom("jet", function, parameters, shapes)
    with pytest.raises(UnusableInput, match=told):
        checked(type("Carriage", (Carriage,), {"ports": [port]})())


def test_one_reading_that_strays_is_no_end_of_the_way():
    recording = recorded(lambda x, v: 200.0 * max(5.2 - x, 0.0))
    recording.columns["position_m"][700] = 20.0
    sizes = LogModel(Carriage(), [recording]).sizes
    assert sizes["highest position_m"] < 6.5
    assert sizes["lowest position_m"] > 5.0


@pytest.mark.whole
def test_a_correction_keeps_the_ends_of_the_way_and_refuses_a_size_below_zero(tmp_path):
    """The rail reaches to the other side of zero; a size of anything else is from zero."""

    class Middle(Carriage):
        ports: ClassVar = [Port.force("speed_mps", inertia="mass_kg", position="position_m")]

    recording = recorded(lambda x, v: 0.0)
    columns = {**recording.columns, "position_m": recording.columns["position_m"] - 5.5}
    model = LogModel(Middle(), [Recording("middle", recording.time_s, columns)])
    base = fitted_base(model)
    path = tmp_path / "correction.toml"
    write_correction(correction_of(model, base), path)
    assert read_correction(path, "Middle").document.sizes == model.sizes
    assert model.sizes["lowest position_m"] < -0.1
    text = path.read_text()
    size = model.sizes["position_m"]
    path.write_text(text.replace(f'"position_m" = {size!r}', f'"position_m" = {-size!r}'))
    assert path.read_text() != text
    with pytest.raises(UnusableInput, match="the size of position_m is"):
        read_correction(path, "Middle")


class Carrying(Carriage):
    """The same, whose motor may push by itself, too."""

    ports: ClassVar = [Port.input("force_n"), *Carriage.ports]


def test_two_forces_that_cancel_give_a_wrong_form_nothing_to_act_on():
    """A wrong form is a share of all that acts, so it is 5 % of nothing where nothing is left."""
    model = LogModel(Carrying(), [recorded(lambda x, v: 0.0)])
    form = {f"form.speed_mps.{k}": (-1) ** k * FORM_MOST for k in range(len(BUMPS))}
    pushes = {"offset@speed_mps.force": 500.0, "bias@force_n.bias": -500.0}
    names = ["offset@speed_mps", "bias@force_n"]
    states = []
    for effects, added in (([], {}), (names, pushes)):
        acting = Acting(
            model.system, [model.library[n] for n in effects], model.sizes, form=["speed_mps"]
        )
        values = {n: np.array([v]) for n, v in (form | added).items()}
        states.append(model.filter.free_run(acting, values)[0])
    assert states[1] == pytest.approx(states[0], abs=1e-9)
