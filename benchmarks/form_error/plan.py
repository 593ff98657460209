"""Which gantries the dose curve flies: frozen by a list and seeds.

In: nothing. Out: cases without any effect over families and misfits, and cases with one.
"""

from benchmarks.form_error.cases import FRICTIONS, MOTORS, NOISES, SENSORS, Case
from benchmarks.form_error.profiles import FAMILIES
from wakedeploy.physics.effects import LIBRARY

DOSES = (0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06)  # misfit of the steady force, of its own size
MEANT = 0.04
_FIRST_SEED = 4100
# Library effects of sizes that matter on the default rig, by `effect.parameter` or constant.
EFFECTS: tuple[dict[str, float], ...] = (
    {"crosswind-offset.offset_m": 0.03},
    {"wake-deflection.deflection_s": 0.12},
    {"wake-inflow-loss.loss_s_per_m": 0.01},
    {"axial-inflow-loss.loss_s_per_m": 0.05},
    {"battery-sag.sag_per_s": 0.003},
    {"ground-effect.gain": 0.15, "ground-effect.height_m": 0.15},
    {"tether-spring.stiffness_n_per_m": 0.5, "tether-spring.slack_m": 0.2},
    {"added-mass.mass_kg": 0.06},
    {"command.delay_s": 0.03},
    {"spool.sufferer.up_s": 0.11, "spool.sufferer.down_s": 0.16},
    {"wake.speed_mps": 4.2},
    {"rail.coulomb_n": 0.25, "rail.stiction_n": 0.25},
)
# What a case's effect is called in the workflow's answer.
NAMES = {
    "command.delay_s": "command-latency",
    "spool.sufferer.up_s": "spool-lag-sufferer",
    "wake.speed_mps": "transport-speed",
    "rail.coulomb_n": "coulomb-friction",
}
TRIVIAL = {"crosswind-offset.offset_m": 0.004, "battery-sag.sag_per_s": 0.0003}


def no_effect(per_dose: int) -> list[Case]:
    """Gantries that lack nothing but form; `per_dose` of each misfit, families taking turns.

    Of misfits beyond what the workflow is meant for, a fifth as many. More of each are further
    ones, so that those flown before stay.
    """
    jets = [family for family in FAMILIES if family != "same"]
    cases = []
    for d, dose in enumerate(DOSES):
        for k in range(per_dose if dose <= MEANT else max(per_dose // 5, 1)):
            number = d + k * len(DOSES)
            jet = "same" if dose == 0.0 else jets[number % len(jets)]
            cases.append(_case(_FIRST_SEED + number, jet, dose, number, {}))
    return cases


def with_effect(per_effect: int) -> list[Case]:
    """Each library effect in gantries of 1 to 4 % misfit."""
    jets = [family for family in FAMILIES if family != "same"]
    cases = []
    for e, effect in enumerate(EFFECTS):
        for k in range(per_effect):
            number = e + k * len(EFFECTS)
            dose = DOSES[1 + number // len(jets) % 4]
            seed = _FIRST_SEED + 500 + number
            cases.append(_case(seed, jets[(number + k) % len(jets)], dose, number + k, effect))
    return cases


def trivial(count: int) -> list[Case]:
    """Exact jets with two true effects that are too small to matter."""
    return [_case(_FIRST_SEED + 900 + k, "same", 0.0, k, TRIVIAL) for k in range(count)]


def hidden_names(case: Case) -> tuple[str, ...]:
    """The library's names of what a case hides."""
    names = (NAMES.get(key, key.partition(".")[0]) for key in case.effects)
    return tuple(dict.fromkeys(n for n in names if n in LIBRARY))


def hidden_name(case: Case) -> str:
    """The first of them; "" for nothing."""
    return next(iter(hidden_names(case)), "")


def _case(seed: int, jet: str, dose: float, number: int, effects: dict[str, float]) -> Case:
    """One case; the other families take turns at paces of their own."""
    return Case(
        seed,
        jet,
        dose,
        friction=list(FRICTIONS)[number // len(FRICTIONS) % len(FRICTIONS)],
        motor=list(MOTORS)[number % len(MOTORS)],
        sensor=list(SENSORS)[(number // 2) % len(SENSORS)],
        noise=list(NOISES)[(number // 3) % len(NOISES)],
        effects=effects,
    )
