"""MATLAB files are read as SciPy reads them, and damaged ones are refused, never a crash."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of
from scipy.io import loadmat, savemat

from wakedeploy.domains.matfile import read_mat

NUMBERS = st.sampled_from(["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4"]).flatmap(
    lambda kind: arrays_of.arrays(np.dtype(kind), arrays_of.array_shapes(max_dims=3, max_side=5))
)
NAMES = st.from_regex(r"[a-zA-Z][a-zA-Z0-9_]{0,30}", fullmatch=True)


@settings(max_examples=100, deadline=None)
@given(variables=st.dictionaries(NAMES, NUMBERS, max_size=4), packed=st.booleans())
def test_numbers_are_read_as_scipy_reads_them(
    variables: dict, packed: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("mat") / "x.mat"
    savemat(path, variables, do_compression=packed)
    expected = loadmat(path)
    read = read_mat(path)
    assert set(read) == {name for name in expected if not name.startswith("__")}
    for name, array in read.items():
        assert array is not None
        np.testing.assert_array_equal(array, expected[name].astype(float))


def test_what_is_not_real_numbers_is_listed_as_none(tmp_path: Path) -> None:
    variables = {"text": "angles", "cell": np.array([1, "a"], object), "struct": {"a": 1.0}}
    savemat(tmp_path / "x.mat", variables | {"c": np.array([1j]), "n": np.arange(3.0)})
    read = read_mat(tmp_path / "x.mat")
    assert [name for name, array in read.items() if array is None] == [*variables, "c"]
    assert read["n"] is not None


def test_numbers_that_matlab_stored_in_a_smaller_type_and_big_endian_files(tmp_path: Path) -> None:
    header = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x01\x00" + b"MI"
    flags = bytes([0, 0, 0, 6, 0, 0, 0, 8, 0, 0, 0, 6, 0, 0, 0, 0])
    dimensions = bytes([0, 0, 0, 5, 0, 0, 0, 8, 0, 0, 0, 3, 0, 0, 0, 1])
    name = bytes([0, 1, 0, 1]) + b"q\0\0\0"
    numbers = bytes([0, 3, 0, 1, 1, 255, 3, 0])  # a double's values as three int8 in the tag
    body = flags + dimensions + name + numbers
    (tmp_path / "x.mat").write_bytes(header + bytes([0, 0, 0, 14, 0, 0, 0, len(body)]) + body)
    np.testing.assert_array_equal(read_mat(tmp_path / "x.mat")["q"], [[1.0], [-1.0], [3.0]])


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[bool, bytes]:
    folder, found = tmp_path_factory.mktemp("mat"), {}
    for packed in (False, True):
        variables = {"time": np.arange(40.0)[None, :], "name": "x", "angle": np.ones((40, 1))}
        savemat(folder / "x.mat", variables, do_compression=packed)
        found[packed] = (folder / "x.mat").read_bytes()
    return found


@settings(max_examples=400, deadline=None)
@given(data=st.data(), packed=st.booleans())
def test_any_damage_is_refused_or_harmless(
    data: st.DataObject,
    packed: bool,
    whole: dict[bool, bytes],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    content = bytearray(whole[packed])
    for _ in range(data.draw(st.integers(0, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    if data.draw(st.booleans()):
        del content[data.draw(st.integers(0, len(content) - 1)) :]
    path = tmp_path_factory.mktemp("mat") / "x.mat"
    path.write_bytes(content)
    try:
        read = read_mat(path)
    except ValueError as refused:
        assert str(refused)  # noqa: PT017
    else:
        assert all(array is None or array.dtype == np.float64 for array in read.values())


@given(content=st.binary(max_size=300))
def test_any_other_file_is_refused(
    content: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "other.mat"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"MATLAB|damaged|7\.3"):
        read_mat(path)


def test_version_7_3_is_named_with_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "x.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(600))
    with pytest.raises(ValueError, match="save it again with"):
        read_mat(tmp_path / "x.mat")
