"""Expressions from files are arithmetic and nothing else, and mean what Python means by them."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.expression import (
    FUNCTIONS,
    MOST_CHARACTERS,
    VARIABLES,
    Binary,
    Call,
    Constant,
    Expression,
    Name,
    Negative,
    parse,
)
from wakedeploy.physics.effects.base import Motion
from wakedeploy.rig.file import default_rig_text, parse_rig

PYTHON = {  # the test's own meaning of each function
    "sin": math.sin,
    "cos": math.cos,
    "exp": math.exp,
    "tanh": math.tanh,
    "abs": abs,
    "sqrt": math.sqrt,
    "sign": lambda x: (x > 0) - (x < 0),
    "min": min,
    "max": max,
}
NUMBERS = st.floats(0, 100, allow_subnormal=False).map(lambda x: Constant(abs(x)))
EXPONENTS = st.integers(0, 4).map(float).map(Constant)


def _larger(smaller):
    one = [name for name, (count, _) in FUNCTIONS.items() if count == 1]
    return st.one_of(
        smaller.map(Negative),
        st.builds(Binary, st.sampled_from("+-*/"), smaller, smaller),
        st.builds(Binary, st.just("**"), smaller, EXPONENTS | EXPONENTS.map(Negative)),
        st.builds(Call, st.sampled_from(one), st.tuples(smaller)),
        st.builds(Call, st.sampled_from(["min", "max"]), st.tuples(smaller, smaller)),
    )


TREES = st.recursive(NUMBERS | st.sampled_from(VARIABLES).map(Name), _larger, max_leaves=12)


@given(TREES)
def test_its_text_reads_back_to_the_same_expression(tree):
    expression = Expression(tree)
    assert parse(expression.text) == expression
    assert parse(expression.text).text == expression.text


@given(TREES, st.lists(st.floats(-3, 3), min_size=len(VARIABLES), max_size=len(VARIABLES)))
def test_values_are_those_of_python(tree, values):
    expression, numbers = Expression(tree), dict(zip(VARIABLES, values, strict=True))
    try:
        expected = eval(expression.text, {"__builtins__": {}}, PYTHON | numbers)
    except (ArithmeticError, ValueError):  # numpy gives inf or nan there
        return
    if isinstance(expected, float | int) and abs(expected) < 1e100:
        assert float(expression(numbers)) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@given(TREES)
def test_arrays_give_what_numbers_give_one_by_one(tree):
    rng = np.random.default_rng(1)
    columns = {name: rng.normal(size=5) for name in VARIABLES}
    expression = Expression(tree)
    together = np.broadcast_to(expression(columns), 5)
    alone = [expression({name: column[i] for name, column in columns.items()}) for i in range(5)]
    np.testing.assert_allclose(together, np.array(alone, float), rtol=1e-9)


@given(st.text() | st.text(alphabet="xz_m()+-*/,.1eE sinmax\n"))
@settings(max_examples=500)
def test_any_text_is_read_or_refused_and_never_anything_else(text):
    try:
        expression = parse(text)
    except UnusableInput:
        return
    assert expression.names <= set(VARIABLES)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "character 1: the end"),
        ("z_m +", "character 6: the end"),
        ("z_m z_m", "character 5: 'z_m' is not expected"),
        ("2*q", "character 3: 'q' is not known; use one of time_s"),
        ("__import__('os')", 'character 12: "\'" is not arithmetic'),
        ("z_m.real", "character 4: '.' is not arithmetic"),
        ("z_m[0]", "character 4: '[' is not arithmetic"),
        ("z_m if x_m else 0", "'if' is not expected"),
        ("lambda: 1", "':' is not arithmetic"),
        ("eval(1)", "'eval' is not known"),
        ("sin", "the end stands where '('"),
        ("sin(1, 2)", "',' stands where ')'"),
        ("max(1)", "')' stands where ','"),
        ("2**2**2", "character 4: '2' is no exponent"),
        ("2**x_m", "'x_m' is no exponent"),
        ("z_m**9", "at most 8"),
        ("1e999", "too large a number"),
        ("(" * 41 + "1" + ")" * 41, "deeper than 40"),
        ("-" * 41 + "1", "deeper than 40"),
        ("1" + "+1" * 300, "comes after 400"),
        ("1" * (MOST_CHARACTERS + 1), "shorten it"),
        ("1_000", "'_000' is not expected"),
        ("٣", "is not arithmetic"),
        ("ｘ_m", "is not arithmetic"),
    ],
)
def test_a_refusal_names_the_character_and_the_way_out(text, told):
    with pytest.raises(UnusableInput) as refused:
        parse(text)
    assert told in str(refused.value)


def test_the_longest_sum_is_read_evaluated_and_written():
    text = "1" + " + 1" * 199
    assert float(parse(text)({})) == 200
    assert parse(text).text == text


def test_numbers_take_the_place_of_names():
    expression = parse("c1*(z_m - c2)", ("c1", "c2", "z_m"))
    assert expression.replaced({"c1": -2.0, "c2": 0.5}).text == "-2*(z_m - 0.5)"
    assert expression.replaced({"c2": parse("1 - x_m")}).text == "c1*(z_m - (1 - x_m))"
    assert expression.names == {"c1", "c2", "z_m"}


def test_division_by_zero_is_infinite_and_silent():
    assert float(parse("1/z_m")({"z_m": 0.0})) == math.inf
    assert math.isnan(float(parse("sqrt(z_m)")({"z_m": -1.0})))


def test_it_may_look_at_everything_an_effect_may_look_at():
    assert {field.name for field in dataclasses.fields(Motion)} == set(VARIABLES)


FORCE = """
[[effect]]
name = "symbolic-force"
expression = "c1*sin(6.28*1.5*time_s) + c2*x_m"

[effect.parameters]
c1 = {value = 0.2, unit = "N", low = 0.1, high = 0.3}
c2 = {value = 0.1, unit = "N/m"}
"""


def test_a_rig_file_keeps_its_expression():
    rig = parse_rig(default_rig_text() + FORCE)
    assert rig.effect[0].expression == "c1*sin(6.28*1.5*time_s) + c2*x_m"
    assert parse_rig(rig.text) == rig


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("c2*x_m", "exit()", "character 27: 'exit' is not known"),
        ("c2*x_m", "x_m", "does not use its parameter 'c2'"),
        ("c2", "x_m", "parameter 'x_m' cannot be told from the rest"),
        ("c2", "exp", "parameter 'exp' cannot be told"),
        ("symbolic-force", "crosswind", "belongs to the effect symbolic-force"),
        ("expression", "note", "effect.0.note is not known"),
    ],
)
def test_a_rig_file_with_another_expression_is_refused(old, new, told):
    with pytest.raises(UnusableInput) as refused:
        parse_rig(default_rig_text() + FORCE.replace(old, new), "my.toml")
    assert told in str(refused.value)
    assert str(refused.value).startswith("my.toml: effect.0")


def test_the_docs_name_every_variable_and_their_example_is_read():
    page = (Path(__file__).parents[2] / "docs" / "reference" / "expressions.md").read_text(
        encoding="utf-8"
    )
    assert all(f"`{name}`" in page for name in (*VARIABLES, *FUNCTIONS))
    example = page.split("```toml")[1].split("```")[0]
    assert parse_rig(default_rig_text() + example).effect[0].name == "symbolic-force"
