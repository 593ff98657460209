"""Units in rig files: others of the same dimension are converted exactly, the rest is refused."""

import math
import re
import tomllib
from itertools import product
from pathlib import Path

import pytest

from wakedeploy.core import units
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.units import (
    contradicted,
    conversion,
    converted,
    is_known,
    same_unit,
    si_unit,
    unit_at_end,
    unit_of,
)
from wakedeploy.rig.file import default_rig, default_rig_text, parse_rig, read_rig


@pytest.mark.parametrize(
    ("given", "wanted", "factor"),
    [
        ("kg", "kg", 1), ("g", "kg", 1e-3), ("mg", "kg", 1e-6), ("KG", "kg", 1),
        ("lb", "kg", 0.45359237), ("oz", "kg", 0.028349523125),
        ("mm", "m", 1e-3), ("cm", "m", 1e-2), ("µm", "m", 1e-6), ("um", "m", 1e-6),
        ("in", "m", 0.0254), ("ft", "m", 0.3048),
        ("ms", "s", 1e-3), ("us", "s", 1e-6), ("min", "s", 60), ("h", "s", 3600),
        ("ms", "us", 1e3), ("s", "us", 1e6),
        ("mN", "N", 1e-3), ("kN", "N", 1e3), ("gf", "N", 9.80665e-3), ("kgf", "N", 9.80665),
        ("lbf", "N", 4.4482216152605), ("kg m/s^2", "N", 1),
        ("mps", "m/s", 1), ("mm/s", "m/s", 1e-3), ("km/h", "m/s", 1 / 3.6), ("m s^-1", "m/s", 1),
        ("mps2", "m/s^2", 1), ("m/s²", "m/s^2", 1), ("cm/s2", "m/s^2", 1e-2),
        ("m s⁻²", "m/s^2", 1), ("m/s**2", "m/s^2", 1),
        ("cm²/s", "m^2/s", 1e-4), ("m2ps", "m^2/s", 1), ("cm^2", "m^2", 1e-4),
        ("Hz", "1/s", 1), ("kHz", "1/s", 1e3), ("1/min", "1/s", 1 / 60), ("s^-1", "1/s", 1),
        ("us/ms", "us/s", 1e3), ("ms/s", "us/s", 1e3),
        ("steps/mm", "steps/m", 1e3), ("step/m", "steps/m", 1),
        ("N/mm", "N/m", 1e3), ("N/(m s)", "N/(m s)", 1), ("N/m/s", "N/(m s)", 1),
        ("Ns/m", "N s/m", 1), ("N*s/m", "N s/m", 1), ("N·s/m", "N s/m", 1), ("N/(m/s)", "N s/m", 1),
        ("V", "V", 1), ("mV", "V", 1e-3), ("deg", "rad", math.pi / 180), ("mrad", "rad", 1e-3),
        ("1", "1", 1), ("", "1", 1), ("%", "1", 1e-2), ("pct", "%", 1), ("minutes", "s", 60),
        ("dps", "rad/s", math.pi / 180), ("rev/min", "rpm", 1), ("rps", "rad/s", 2 * math.pi),
        ("mNm", "N m", 1e-3), ("Nmm", "N m", 1e-3), ("psi", "Pa", 6894.757293168361),
        ("knots", "km/h", 1.852), ("M/S", "m/s", 1), ("KM/H", "km/h", 1),
        ("l/min", "m^3/s", 1e-3 / 60), ("Volts", "V", 1), ("mH", "V s/A", 1e-3), ("uF", "F", 1e-6),
        *((knot, "m/s", 1852 / 3600) for knot in ("kt", "KT", "kts", "Kts", "KTS", "knot")),
        ("kOhm", "ohm", 1e3), ("uT", "T", 1e-6), ("MM", "m", 1e-3), ("KHz", "Hz", 1e3),
        ("Kg", "kg", 1), ("mSec", "s", 1e-3),
        ("kΩ", "ohm", 1e3), ("N/(m/s)²", "N s²/m²", 1), ("N/(m/s)^2", "N s²/m²", 1),
    ],
)  # fmt: skip
def test_a_unit_of_the_same_dimension_has_a_factor(given: str, wanted: str, factor: float) -> None:
    assert float(conversion(given, wanted)) == pytest.approx(factor, rel=1e-15)
    assert same_unit(given, wanted) == (factor == 1)


@pytest.mark.parametrize(
    ("given", "wanted", "why"),
    [
        ("N", "kg", "'N' is of another dimension; give kg, g, mg, lb or oz"),
        ("s", "m", "'s' is of another dimension; give m, cm, mm, um, in or ft"),
        ("ms", "m/s", "another dimension"),
        ("N/(ms)", "N/(m s)", "another dimension"),  # per millisecond
        ("kilos", "kg", "'kilos' is not known; give kg, g"),
        ("furlong", "m", "not known"), ("m/", "m", "not known"), ("(m", "m", "not known"),
        ("G", "kg", "not known"), ("mG", "g", "not known"),  # gauss, or of gravity
        ("H", "s", "another dimension"), ("M", "m", "not known"), ("mS", "s", "another dimension"),
        ("MHZ", "Hz", "not known"), ("NM", "m", "not known"), ("kn", "N", "not known"),
        ("10", "1", "not known"), ("m^x", "m", "not known"), ("?", "m", "not known"),
        ("kn", "m/s", "'kn' is not known: kN or knots may be meant; give which"),
        ("Kn", "m/s", "kN or knots"), ("KN", "N", "kN or knots"), ("kn/m", "N/m", "not known"),
        ("mpa", "Pa", "'mpa' is not known: MPa or mPa may be meant; give which"),
        ("mhz", "Hz", "MHz or mHz"), ("kv", "V", "'kv' is not known: kV may be meant; give that"),
        ("kT", "T", "not known"), ("t", "T", "T may be meant"), ("NS", "s", "Ns or ns"),
    ],
)  # fmt: skip
def test_another_dimension_or_an_unknown_unit_is_refused(given: str, wanted: str, why: str) -> None:
    with pytest.raises(ValueError, match="give ") as told:
        conversion(given, wanted)
    assert why in str(told.value)


SI_OF = {  # of each symbol that is understood in other cases, too
    "m": ("m", 1), "cm": ("m", 1e-2), "dm": ("m", 1e-1), "km": ("m", 1e3), "mm": ("m", 1e-3),
    "um": ("m", 1e-6), "g": ("kg", 1e-3), "kg": ("kg", 1), "s": ("s", 1), "us": ("s", 1e-6),
    "n": ("N", 1), "nm": ("N m", 1), "mn": ("N", 1e-3), "mnm": ("N m", 1e-3),
    "knm": ("N m", 1e3), "nmm": ("N m", 1e-3), "gf": ("N", 9.80665e-3), "kgf": ("N", 9.80665),
    "hz": ("Hz", 1), "khz": ("Hz", 1e3), "v": ("V", 1), "mv": ("V", 1e-3), "uv": ("V", 1e-6),
    "a": ("A", 1), "ma": ("A", 1e-3), "ua": ("A", 1e-6), "w": ("W", 1), "mw": ("W", 1e-3),
    "kw": ("W", 1e3), "j": ("J", 1), "kj": ("J", 1e3), "pa": ("Pa", 1), "kpa": ("Pa", 1e3),
    "ut": ("T", 1e-6), "ohm": ("ohm", 1), "kohm": ("ohm", 1e3), "rad": ("rad", 1),
    "deg": ("rad", math.pi / 180), "rev": ("rad", 2 * math.pi), "rpm": ("rad/s", math.pi / 30),
    "rps": ("rad/s", 2 * math.pi), "dps": ("rad/s", math.pi / 180), "bar": ("Pa", 1e5),
    "mbar": ("Pa", 100), "psi": ("Pa", 6894.757293168361), "min": ("s", 60), "h": ("s", 3600),
    "in": ("m", 0.0254), "ft": ("m", 0.3048), "lb": ("kg", 0.45359237), "step": ("steps", 1),
    "oz": ("kg", 0.028349523125), "lbf": ("N", 4.4482216152605), "steps": ("steps", 1),
    "mps": ("m/s", 1), "mps2": ("m/s^2", 1), "m2ps": ("m^2/s", 1), "kmh": ("m/s", 1 / 3.6),
    "l": ("m^3", 1e-3), "kt": ("m/s", 1852 / 3600), "knots": ("m/s", 1852 / 3600),
    "counts": ("1", 1),
}  # fmt: skip


@pytest.mark.whole
def test_a_symbol_in_other_cases_is_what_it_is_listed_as_or_is_refused() -> None:
    """Every spelling of every symbol, in whatever capitals: no case makes another unit of it."""
    names = [name for name in units._SYMBOLS if name.isascii() and name.isalnum()]
    words = {word: unit for unit, words in units._SPOKEN.items() for word in words.split()}
    for spelling in sorted({way for name in names for way in _in_all_cases(name)} - {*names}):
        beside, folded = (
            f"{spelling}/1",
            spelling.lower(),
        )  # no electrical symbol, which stands alone
        if is_known(beside):
            wanted, size = (words[folded], 1) if folded in words else SI_OF[folded]
            assert float(conversion(beside, wanted)) == pytest.approx(size, rel=1e-15), spelling
            alike = {n for n in names if n.lower() == folded and not same_unit(n, beside)}
            assert not alike or spelling in {"MM", "ma", "mn", "mnm", "mv", "mw"}, spelling


def _in_all_cases(name: str) -> set[str]:
    return {"".join(way) for way in product(*({c.lower(), c.upper()} for c in name))}


def test_every_unit_that_the_manual_lists_is_known() -> None:
    manual = Path(__file__).parents[2] / "docs" / "how-to" / "own-logs.md"
    section = manual.read_text(encoding="utf-8").split("### Units")[1].split("## Time")[0]
    rows = [line for line in section.splitlines() if line.startswith("| ") and "`" in line]
    listed = [unit for row in rows for unit in re.findall("`([^`]+)`", row)]
    assert len(listed) > 30
    for unit in listed:
        assert si_unit(unit)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("resistance_ohm", "ohm"), ("push_n_per_v", "N/V"), ("drag_nm_per_radps", "N m/(rad/s)"),
        ("inertia_kgm2", "kg m²"), ("inertia_kg_m2", "kg m²"), ("speed_rpm", "rpm"),
        ("torque_nm_per_a", "N m/A"), ("drop_n_per_ms", "N/(m s)"), ("arm_a", None),
        ("length_m", "m"), ("m", None), ("capacity_j_per_k", "J/K"), ("axis_j", None),
        ("inflow_per_s", None), ("gain", None), ("rest_bar", "bar"), ("supply_kpa", "kPa"),
        ("bar", None), ("torque_nm_per_bar", "N m/bar"), ("density_kg_per_m3", "kg/m³"),
        ("bore_cm", "cm"), ("supply_psi", "psi"),
    ],
)  # fmt: skip
def test_a_name_s_end_says_its_unit(name: str, unit: str | None) -> None:
    assert unit_at_end(name) == unit


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("flow_m3_per_s", "m³/s"),
        ("rise_k_per_s", "K/s"),
        ("conductance_m3_per_s_pa", "m³/(s Pa)"),
        ("heat_j_per_kg_k", "J/(kg K)"),
        ("drag_n_s_per_m", "N s/m"),
        ("fall_per_s2", "1/s²"),
        ("leak_mbar_per_s", "mbar/s"),
        ("steps_per_m", "steps/m"),
        ("stiffness_n_per_m", "N/m"),
        ("kd_nm_s_per_rad", "N m s/rad"),
        ("kd_n_m_s_per_rad", "N m s/rad"),
        ("ke_v_s_per_rad", "V s/rad"),
        ("drag_n_s2_per_m2", "N s²/m²"),
        ("gain_n_m_per_a", "N m/A"),
        ("gain_per_volt", None),
        ("per_s", None),
    ],
)
def test_what_stands_below_per_is_all_of_it(name: str, unit: str | None) -> None:
    """A flow_m3_per_s had 1/s, and a conductance_m3_per_s_pa was a pressure."""
    assert unit_at_end(name) == unit
    assert unit is None or is_known(unit)
    if unit is not None:
        assert conversion(unit, unit) == 1  # one that is understood


@pytest.mark.parametrize(
    "name",
    [
        "torque_per_a", "force_per_v", "thrust_per_rpm", "pwm_per_v", "current_per_nm",
        "energy_kwh_per_kg", "kd_nms_per_rad", "tonnes_per_m", "near_per_kg", "force_per_n",
        "n_m_per_v", "v_s_per_rad",  # all of the name is units: one letter of them names something
        "gain_m_s_per_v", "gain_rad_s_per_v",  # m s/V, or m/s a volt
        "gain_k_n_per_v", "flow_min_per_v", "motor_kt_per_a",
    ],
)  # fmt: skip
def test_a_word_above_per_that_is_no_unit_leaves_it_open(name: str) -> None:
    """A torque_per_a had 1/A, and a kd_nm_s_per_rad was a time by an angle."""
    assert unit_at_end(name) is None
    assert unit_of(name) is None  # nor is a force_per_n in newtons


@pytest.mark.parametrize(
    ("name", "unit", "named"),
    [
        ("dx_cm", "m", "cm"), ("dx_cm", "cm", None), ("way_km", "m", "km"), ("v_kmh", "m/s", "kmh"),
        ("wind_kt", "m/s", "knots"), ("wind_kts", "m/s", "knots"), ("wind_knots", "kt", None),
        ("wind_kn", "m/s", "knots"), ("push_kn", "N", "kN"), ("push_kn", "kN", None),
        ("p_mbar", "Pa", "mbar"), ("p_bar", "Pa", "bar"), ("p_kpa", "bar", "kPa"),
        ("x_bar", "m", None), ("motor_kt", "N m/A", None), ("motor_km", "N m/A", None),  # no units
        ("rel_vx_mps", "T", "m/s"), ("encoder_mm", "V", None), ("servo_deg", "us", None),
        ("drag_n_per_kmh", "N/kmh", None), ("stiffness_n_per_cm", "N/cm", None),
        ("torque_n_mm", "N mm", None), ("load_kg", "N", None),
        ("encoder_m", "V", None), ("x_s", "m", None), ("u_n", "V", None), ("vx_mps", "1", None),
        ("yaw_rad", "1", None), ("speed_rpm", "Hz", "rpm"), ("mps", "T", None),
        ("kraft_mN", "N", "mN"), ("f_un", "N", "uN"), ("tau_nmm", "N m", "Nmm"),
        ("v_km_h", "m/s", "kmh"), ("v_m_s", "m/s", None), ("gyro_deg_s", "rad/s", "deg/s"),
        ("tau_n_m", "N m", None), ("mass_g", "kg", "g"), ("acc_g", "m/s^2", None),
        ("load_MN", "MN", None), ("load_MN", "N", "MN"), ("power_MW", "MW", None),
        ("damping_n_m_s", "N m s", None), ("pos_m_s", "m", None), ("lag_m_s", "s", None),
    ],
)  # fmt: skip
def test_a_name_contradicts_another_unit(name: str, unit: str, named: str | None) -> None:
    assert contradicted(name, unit) == named


@pytest.mark.parametrize("name", ["thrust_mn", "force_un", "mass_g"])
def test_an_end_that_may_be_a_word_s_is_doubted_and_not_refused(name: str) -> None:
    unit = "kg" if name.endswith("_g") else "N"
    assert contradicted(name, unit)
    assert contradicted(name, unit, surely=True) is None


def test_conversion_rounds_once() -> None:
    for grams in range(1, 2000):
        assert converted(grams, conversion("g", "kg")) == float(f"{grams}e-3")
    assert converted(0.98, conversion("ms", "us")) == 980.0
    assert converted(math.inf, conversion("g", "kg")) == math.inf


def test_each_constant_of_a_rig_has_a_unit_that_is_known() -> None:
    for section, table in tomllib.loads(default_rig().text).items():
        for name in table if isinstance(table, dict) else ():
            wanted = unit_of(name)
            if wanted is not None:
                assert conversion(wanted, wanted) == 1, f"{section}.{name}"


def rig(old: str, new: str) -> str:
    text = default_rig_text()
    assert text.count(old) == 1, old
    return text.replace(old, new)


def test_grams_are_a_mass() -> None:
    entry = 'mass_kg = { value = 452, spread = 2, unit = "g", date = 2026-11-20 }'
    read = parse_rig(rig("mass_kg = 0.45\n", f"{entry}\n"))
    assert read.sufferer.mass_kg == 0.452
    known = read.calibration["sufferer.mass_kg"]
    assert (known.spread, known.unit, known.date) == (0.002, "kg", "2026-11-20")
    plain = 'mass_kg = { value = 0.452, spread = 0.002, unit = "kg", date = 2026-11-20 }'
    assert read == parse_rig(rig("mass_kg = 0.45\n", f"{plain}\n"))
    assert parse_rig(read.text) == read


def test_numbers_without_a_unit_are_in_the_constants_own() -> None:
    assert parse_rig(rig("mass_kg = 0.45\n", "mass_kg = { value = 0.5, spread = 0.01 }\n")) == (
        default_rig().changed(sufferer={"mass_kg": {"value": 0.5, "spread": 0.01}})
    )
    assert default_rig().sufferer.mass_kg == 0.45


def test_lists_are_converted(tmp_path: Path) -> None:
    thrust = default_rig().thrust.sufferer
    grams = [round(1000 * n / 9.80665, 3) for n in thrust.thrust_n]
    path = tmp_path / "rig.toml"
    section = (
        "[thrust.sufferer]\n"
        f'pulse_us = {{ value = {[us / 1000 for us in thrust.pulse_us]}, unit = "ms" }}\n'
        f'thrust_n = {{ value = {grams}, spread = 10, unit = "gf" }}\n'
    )
    start = default_rig_text().index("[thrust.sufferer]")
    end = default_rig_text().index("\n[", start) + 1
    path.write_text(default_rig_text()[:start] + section + default_rig_text()[end:])
    read = read_rig(path)
    assert read.thrust.sufferer.pulse_us == thrust.pulse_us
    assert read.thrust.sufferer.thrust_n == pytest.approx(thrust.thrust_n, abs=1e-5)
    assert read.calibration["thrust.sufferer.thrust_n"].spread == 0.0980665


EFFECT = '\n[[effect]]\nname = "range-bias"\n[effect.parameters]\nbias_m = '


def test_parameters_of_effects_are_converted_with_their_bounds() -> None:
    entry = '{ value = 5, unit = "mm", low = -1, high = 11 }\n'
    read = parse_rig(default_rig_text() + EFFECT + entry)
    bias = read.effect[0].parameters["bias_m"]
    assert (bias.value, bias.unit, bias.low, bias.high) == (0.005, "m", -0.001, 0.011)
    assert parse_rig(read.text) == read  # as `gap add` writes it


def test_an_expressions_parameters_have_units_of_their_own() -> None:
    text = default_rig_text() + (
        '\n[[effect]]\nname = "symbolic-force"\nexpression = "c1 * vz_mps"\n'
        'parameters = { c1 = { value = 3.0, unit = "mN s/m" } }\n'
    )
    (effect,) = parse_rig(text).effect
    assert effect.parameters["c1"].unit == "mN s/m"
    assert effect.parameters["c1"].value == 3.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (rig("mass_kg = 0.45\n", 'mass_kg = { value = 450, unit = "N" }\n'),
         "sufferer.mass_kg is in kg, and its unit 'N' is of another dimension; give kg, g, mg,"),
        (rig("mass_kg = 0.45\n", 'mass_kg = { value = 450, unit = "stone" }\n'),
         "sufferer.mass_kg is in kg, and its unit 'stone' is not known; give kg, g"),
        (default_rig_text() + EFFECT + '{ value = 5, unit = "ms" }\n',
         "range-bias.bias_m is in m, and its unit 'ms' is of another dimension; give m, cm"),
        (rig("mass_kg = 0.45\n", 'mass_kg = { value = 450, unit = "kg" }\n'), "mass_kg = 450"),
        (rig("mass_kg = 0.45\n", 'mass_kg = { value = "heavy", unit = "g" }\n'), "'heavy'"),
        (rig("mass_kg = 0.45\n", "mass_kg = { value = 1, unit = 3 }\n"), "unit"),
    ],
)  # fmt: skip
def test_what_cannot_be_converted_is_refused_by_name(text: str, words: str) -> None:
    with pytest.raises(UnusableInput) as told:
        parse_rig(text, "my.toml")
    assert str(told.value).startswith("my.toml: ")
    assert words in str(told.value)


@pytest.mark.parametrize(
    ("unit", "known"),
    [("m^0.5/s", True), ("m^(1/2)/s", True), ("N/(m/s)^1.5", True), ("", True), ("1", True),
     ("kilo", False), ("kilo^0.5", False), ("m^x", False)],
)  # fmt: skip
def test_a_unit_is_known_also_where_nothing_converts_to_it(unit: str, known: bool) -> None:
    assert is_known(unit) == known
