"""A sentence stays one line that a terminal can show, whatever a file has put into it."""

import pytest

from wakedeploy.core.errors import CheckFailed, UnusableInput, one_line
from wakedeploy.core.files import json_of, read_json_lines, toml_of

DEEP = 100_000


@pytest.mark.parametrize("kind", [UnusableInput, CheckFailed])
def test_foreign_letters_do_not_reach_the_terminal(kind: type[Exception]) -> None:
    told = str(kind("rig.toml: name = '\x1b[2J\x00\u202e\ud800' is\nnot known; remove it."))
    assert told.isprintable()
    assert told == r"rig.toml: name = '\x1b[2J\x00\u202e\ud800' is not known; remove it."


def test_a_sentence_that_a_file_made_long_keeps_its_beginning_and_its_end() -> None:
    told = str(UnusableInput(f"rig.toml: '{'x' * 10_000}' is not known; remove it."))
    assert len(told) < 1000
    assert told.startswith("rig.toml: 'xxx")
    assert told.endswith("xxx' is not known; remove it.")
    assert len(one_line(ValueError("y" * 10_000))) < 1000


@pytest.mark.parametrize(
    ("read", "text"),
    [(json_of, "[" * DEEP), (json_of, '{"a":' * DEEP), (toml_of, f"a = {'[' * DEEP}")],
)
def test_what_is_nested_too_deeply_is_no_document(read, text: str) -> None:
    with pytest.raises(ValueError, match="nested too deeply"):
        read(text)


def test_a_line_that_is_nested_too_deeply_counts_as_torn(tmp_path) -> None:
    path = tmp_path / "lines.jsonl"
    path.write_text(f'{{"a": 1}}\n{"[" * DEEP}\n{{"a": 2}}\n')
    assert read_json_lines(path) == [{"a": 1}, {"a": 2}]


@pytest.mark.parametrize("part", ["a", "\x00", "\x1b[31m", "\U000e0001", "word "])
def test_a_sentence_is_short_whatever_a_file_has_put_into_it(part: str) -> None:
    """What is shown of a letter that no terminal has is ten times as long."""
    said = str(UnusableInput(f"plan.csv: the columns are {part * 5000}; give others."))
    assert len(said) < 900
    assert said.isprintable()
    assert said.startswith("plan.csv: the columns are ")
    assert said.endswith("; give others.")
