"""The pieces that C is written from, over inputs that nobody chose."""

import ctypes
import dataclasses
import re
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from needs import c_compiler

from export.c.identifiers import Names, require_name
from export.c.kernels import needed
from export.c.rounding import _integers
from export.c.source import _plain, _quoted
from export.c.values import literal
from export.c.weights import Kind, Matrix
from runtime.compiled.compiler import compiled
from runtime.compiled.folder import _ESCAPED
from wakedeploy.core.errors import UnusableInput

KINDS = get_args(Kind)
_NUMPY = {"float32": np.float32, "float16": np.uint16, "int8": np.int8}


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_a_number_is_the_same_to_the_last_bit(value):
    text = literal(value)
    assert np.float32(text.removesuffix("f")) == np.float32(value)
    assert re.fullmatch(r"-?\d+\.\d*(e[+-]\d+)?f", text), text


@settings(max_examples=50)
@given(st.lists(st.text(max_size=45), max_size=8))
def test_any_names_become_different_ones_that_c_takes(wishes):
    names = Names()
    made = [names.new(wish) for wish in wishes]
    assert len(set(made)) == len(made)
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) for name in made)
    assert not {"int", "main", "dense", "state", "tanh"} & set(made)


@given(st.text(alphabet=st.characters(max_codepoint=126, min_codepoint=32), max_size=400))
def test_a_text_in_literals_is_read_back(text):
    lines = _quoted(text).splitlines()
    assert all(len(line) < 130 for line in lines)
    pieces = "".join(line.strip()[1:-1] for line in lines)
    assert _ESCAPED.sub(r"\1", pieces) == text
    assert "??" not in pieces, "three letters that C once read as one"


@given(st.text(max_size=80))
def test_no_text_ends_a_comment_or_goes_on_to_the_next_line(text):
    plain = _plain(text)
    assert "*/" not in plain
    assert "/*" not in plain
    assert "\\" not in plain
    assert plain.isascii()


@pytest.mark.parametrize(
    "name",
    [
        *("", "9lives", "a-b", "int", "while", "state", "ä", "x" * 40, "a b"),
        *("math", "stdint", "Stdio", "wake_test"),
    ],
)
def test_a_name_that_c_does_not_take_is_refused(name):
    with pytest.raises(UnusableInput, match="--name"):
        require_name(name)


@pytest.fixture(scope="module")
def kernels(tmp_path_factory):
    """The two products for each kind of weights, callable."""
    folder = tmp_path_factory.mktemp("kernels")
    made = {}
    for kind in KINDS:
        path = folder / f"{kind}.c"
        text = "\n".join(needed("dense( sparse( few(", kind)).replace(
            "static AS_WRITTEN", "AS_WRITTEN"
        )
        path.write_text(f"#include <stdint.h>\n#define FLASH\n{text}", encoding="utf-8")
        made[kind] = ctypes.CDLL(
            str(compiled([path], folder / f"{kind}.so", ("-O2", "-shared", "-fPIC")))
        )
    return made


def _at(array):
    return (
        np.ascontiguousarray(array).ctypes.data_as(ctypes.c_void_p) if array is not None else None
    )


@c_compiler
@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(KINDS), st.integers(8, 40), st.integers(1, 70), st.booleans(),
    st.integers(0, 1 << 30),
)  # fmt: skip
def test_products_of_any_size_are_those_of_the_kept_weights(
    kernels, kind, outputs, inputs, has_bias, seed
):
    draw = np.random.default_rng(seed)
    sparse = Matrix("w", _sparse(draw, outputs, inputs))
    dense = Matrix("w", draw.normal(size=(outputs, inputs)).astype(np.float32))
    x = draw.normal(size=inputs).astype(np.float32)
    bias = draw.normal(size=outputs).astype(np.float32) if has_bias else None
    for matrix, name in ((dense, "dense"), (sparse, "sparse")):
        y = np.empty(outputs, np.float32)
        arrays = _arrays(matrix, kind, is_sparse=name == "sparse")
        sizes = [outputs] if name == "sparse" else [inputs, outputs]
        getattr(kernels[kind], name)(*map(_at, arrays), _at(bias), _at(x), _at(y), *sizes)
        expected = matrix.rounded(kind) @ x + (0.0 if bias is None else bias)
        assert np.allclose(y, expected, rtol=1e-5, atol=2e-5)


@c_compiler
@pytest.mark.parametrize("outputs", [1, 2, 7, 20])
def test_few_rows_and_what_drives_a_reservoir_stay_float32(kernels, outputs):
    draw = np.random.default_rng(outputs)
    weights = draw.normal(size=(outputs, 33)).astype(np.float32)
    matrix = Matrix("w", weights, drives=outputs > 7)
    assert matrix.kept("int8") == "float32"
    assert np.array_equal(matrix.rounded("int8"), weights)
    assert matrix.flash_bytes("int8") == 4 * weights.size
    (declared,) = matrix.declarations("int8")
    kept = _numbers(declared.split(" = {")[1]).astype(np.float32)
    x, bias = draw.normal(size=33).astype(np.float32), np.ones(outputs, np.float32)
    y = np.empty(outputs, np.float32)
    kernels["int8"].few(_at(kept), _at(bias), _at(x), _at(y), 33, outputs)
    assert np.allclose(y, weights @ x + bias, atol=1e-5)


def test_a_reservoirs_integers_keep_its_products_rather_than_its_entries():
    """Activations that move together, as a reservoir's do: three numbers drive a hundred."""
    draw = np.random.default_rng(3)
    matrix = Matrix("w", _sparse(draw, 100, 100))
    activations = np.tanh(0.3 * draw.normal(size=(300, 3)) @ draw.normal(size=(3, 100)))
    seen, unseen = activations[:200], activations[200:]
    together = dataclasses.replace(matrix, integers=_integers(matrix, seen))
    errors = [
        np.linalg.norm((m.rounded("int8") - m.weights) @ unseen.T) for m in (matrix, together)
    ]
    assert errors[1] < 0.5 * errors[0]
    assert not np.any(together.stored("int8")[matrix.weights == 0.0])
    assert np.abs(together.stored("int8").astype(int)).max() <= 127
    assert np.array_equal(together.stored("float32"), matrix.weights)
    assert np.array_equal(_integers(matrix, np.nan * seen), matrix.stored("int8"))


def _sparse(draw, outputs, inputs):
    weights = draw.normal(size=(outputs, inputs)) * (draw.random((outputs, inputs)) < 0.2)
    return weights.astype(np.float32)


def _arrays(matrix, kind, is_sparse):
    """What is handed over before the bias, read back from the declarations as C has them."""
    forced = Matrix(matrix.name, matrix.weights)
    object.__setattr__(forced, "__class__", _Sparse if is_sparse else _Dense)
    arrays = []
    for text in forced.declarations(kind):
        declared, numbers = text.split(" = {")
        dtype = next(
            t for word, t in (("uint16_t", np.uint16), ("int8_t", np.int8), ("float", np.float32))
            if f" {word} " in declared
        )  # fmt: skip
        arrays.append(_numbers(numbers).astype(dtype))
    if kind == "int8":  # the scale comes second in a call and last among the declarations
        arrays.insert(1, arrays.pop())
    return arrays


def _numbers(text):
    """The numbers of an initialiser."""
    values = (n.strip().removesuffix("f") for n in text.removesuffix("};").split(","))
    return np.array([float(v) for v in values if v])


class _Sparse(Matrix):
    is_sparse = True


class _Dense(Matrix):
    is_sparse = False
