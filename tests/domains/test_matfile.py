"""MATLAB files are read as SciPy reads them, and damaged ones are refused, never a crash."""

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays_of
from scipy.io import loadmat, savemat

from wakedeploy.domains import matfile
from wakedeploy.domains.matfile import Unread, read_mat

NUMBERS = st.sampled_from(["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4"]).flatmap(
    lambda kind: arrays_of.arrays(np.dtype(kind), arrays_of.array_shapes(max_dims=3, max_side=5))
)
NAMES = st.from_regex(r"[a-zA-Z][a-zA-Z0-9_]{0,30}", fullmatch=True)


@pytest.mark.whole
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
        assert not isinstance(array, Unread)
        np.testing.assert_array_equal(array, expected[name].astype(float))


def test_what_is_not_real_numbers_is_listed_with_what_it_is(tmp_path: Path) -> None:
    variables = {"text": "angles", "cell": np.array([1, "a"], object), "c": np.array([1j])}
    runs = np.array([(1.0, 2.0), (3.0, 4.0)], [("t", object), ("x", object)])
    savemat(tmp_path / "x.mat", variables | {"runs": runs, "n": np.arange(3.0)})
    read = read_mat(tmp_path / "x.mat")
    unread = {name: value for name, value in read.items() if isinstance(value, Unread)}
    assert [*unread] == [*variables, "runs"]
    assert unread["text"] == ("is text", "")
    assert unread["cell"].advice == (
        "in MATLAB: s = struct('x', cell2mat(cell)); save log.mat -struct s"
    )
    assert unread["runs"].reason == "is a struct array of 1 x 2"
    assert "[runs.t]" in unread["runs"].advice


@pytest.mark.parametrize("packed", [False, True])
def test_the_fields_of_a_struct_are_variables_as_scipy_reads_them(
    packed: bool, tmp_path: Path
) -> None:
    x = np.arange(12.0).reshape(4, 3)
    log = {"t": np.arange(4.0), "arm": {"q": x, "n": np.int8([1, -2]), "who": "me"}, "a_b": 2.5}
    savemat(tmp_path / "x.mat", {"log": log, "u": np.ones(4)}, do_compression=packed)
    read = read_mat(tmp_path / "x.mat")
    assert [*read] == ["log/t", "log/arm/q", "log/arm/n", "log/arm/who", "log/a_b", "u"]
    whole = loadmat(tmp_path / "x.mat", squeeze_me=True, struct_as_record=False)["log"]
    for name in ("t", "a_b"):
        np.testing.assert_array_equal(np.squeeze(read[f"log/{name}"]), getattr(whole, name))
    np.testing.assert_array_equal(read["log/arm/q"], whole.arm.q)
    np.testing.assert_array_equal(np.squeeze(read["log/arm/n"]), whole.arm.n)
    assert read["log/arm/who"] == ("is text", "")


def element(kind: int, content: bytes) -> bytes:
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def mat(*variables: bytes) -> bytes:
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01" + b"IM" + b"".join(variables)


def object_of(of: bytes, name: bytes) -> bytes:
    """A variable of a class of MATLAB's own, such as a timeseries."""
    flags = element(6, struct.pack("<II", 17, 0))
    parts = [flags, *(element(1, text) for text in (name, b"MCOS", of))]
    return element(14, b"".join(parts))


def test_objects_of_matlab_are_named_by_their_class_and_what_it_keeps_for_them_is_no_variable(
    tmp_path: Path,
) -> None:
    kept = element(6, struct.pack("<II", 9, 0)) + element(5, struct.pack("<ii", 1, 2))
    nameless = element(14, kept + element(1, b"") + element(2, b"ab"))
    content = mat(object_of(b"timeseries", b"run"), object_of(b"timetable", b"tt"), nameless)
    (tmp_path / "x.mat").write_bytes(content)
    read = read_mat(tmp_path / "x.mat")
    assert [*read] == ["run", "tt"]
    assert read["run"] == (
        "is a timeseries",
        "in MATLAB: s = struct('t', run.Time, 'x', run.Data); save log.mat -struct s",
    )
    assert isinstance(read["tt"], Unread)
    assert "seconds(tt.Time" in read["tt"].advice


def test_structs_have_bounds_in_depth_in_number_and_in_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "x.mat"
    flags = element(6, struct.pack("<II", 2, 0)) + element(5, struct.pack("<ii", 1, 1))
    deep = b""
    for _ in range(5000):  # deeper than Python's own stack
        deep = element(
            14, flags + element(1, b"s") + element(5, b"\2\0\0\0") + element(1, b"s\0") + deep
        )
    path.write_bytes(mat(deep))
    with pytest.raises(ValueError, match="more than 16 deep"):
        read_mat(path)
    savemat(path, {"log": {"a": np.zeros(100, np.int8), "b": np.zeros(100, np.int8)}})
    monkeypatch.setattr(matfile, "MOST_BYTES", 1700)
    assert len(read_mat(path)) == 2
    monkeypatch.setattr(matfile, "MOST_BYTES", 1500)
    with pytest.raises(ValueError, match="unpacked"):
        read_mat(path)
    monkeypatch.undo()
    names = b"".join(f"{k:07}".encode() + b"\0" for k in range(10_001))
    many = flags + element(1, b"s") + element(5, b"\x08\0\0\0") + element(1, names)
    path.write_bytes(mat(element(14, many + element(14, b"") * 10_001)))  # never filled
    with pytest.raises(ValueError, match="more than 10000 variables"):
        read_mat(path)


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
        variables |= {"log": {"x": np.ones(5), "arm": {"q": np.ones(3)}}}
        savemat(folder / "x.mat", variables, do_compression=packed)
        found[packed] = (folder / "x.mat").read_bytes()
    return found


@pytest.mark.whole
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
        assert all(isinstance(v, Unread) or v.dtype == np.float64 for v in read.values())


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
