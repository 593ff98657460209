"""Whether every file in a folder is whole: read by its reader, or parsed as what its name says."""

import csv
import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from PIL import Image

from trainers.preset import read_preset
from trainers.trained_run import load_run
from trainers.training.runs import CONFIG, METRICS, read_config, read_metrics, read_tensors
from wakedeploy.core.episodes import DESCRIPTION, read_episode_set
from wakedeploy.core.errors import WakedeployError
from wakedeploy.core.package import read_package
from wakedeploy.core.runlog import read_run_log
from wakedeploy.rig.file import read_rig

_FAILURES = (WakedeployError, OSError, ValueError, KeyError, EOFError, BadZipFile)


def broken_files(folder: Path) -> list[str]:
    """What is wrong with each visible file below a folder that is not whole."""
    found = []
    for path in sorted(folder.rglob("*")):
        if path.name.startswith(".") or not path.is_file():
            continue
        try:
            _reader(path)(path)
        except _FAILURES as error:
            found.append(f"{path.relative_to(folder)}: {type(error).__name__}: {error}")
    return found


def unfinished_bytes(folder: Path) -> int:
    """Bytes of files that have no name of their own yet."""
    hidden = [path for path in folder.rglob(".*") if path.is_file()]
    return sum(path.stat().st_size for path in hidden)


def _reader(path: Path) -> Callable[[Path], object]:
    by_name = {CONFIG: _run_config, METRICS: _run_metrics, DESCRIPTION: _set}
    return by_name.get(path.name) or _BY_SUFFIX[path.suffix]


def _run_config(path: Path) -> None:
    read_config(path.parent)


def _run_metrics(path: Path) -> None:
    read_metrics(path.parent)
    load_run(path.parent)


def _set(path: Path) -> None:
    read_episode_set(path.parent)


def _npz(path: Path) -> None:
    with np.load(path, allow_pickle=False) as archive:
        for name in archive.files:
            archive[name]


def _csv(path: Path) -> None:
    text = path.read_text("utf-8")
    widths = {len(row) for row in csv.reader(text.splitlines())}
    if len(widths) != 1 or not text.endswith("\n"):
        raise ValueError(f"rows of {sorted(widths)} cells")


def _lines(path: Path) -> None:
    """All but the last line: that one may be torn, and readers pass over it."""
    for line in path.read_bytes().split(b"\n")[:-1]:
        json.loads(line)


def _toml(path: Path) -> None:
    document = tomllib.loads(path.read_text("utf-8"))
    if "arch" in document:
        read_preset(path)
    else:
        read_rig(path)


def _page(path: Path) -> None:
    if not path.read_text("utf-8").rstrip().endswith("</html>"):
        raise ValueError("the page has no end")


def _picture(path: Path) -> None:
    with Image.open(path) as image:
        image.load()


def _paper(path: Path) -> None:
    if not path.read_bytes().rstrip().endswith(b"%%EOF"):
        raise ValueError("the PDF has no end")


_BY_SUFFIX: dict[str, Callable[[Path], object]] = {
    ".json": lambda path: json.loads(path.read_text("utf-8")),
    ".safetensors": read_tensors,
    ".npz": _npz,
    ".csv": _csv,
    ".jsonl": _lines,
    ".journal": _lines,
    ".toml": _toml,
    ".html": _page,
    ".png": _picture,
    ".pdf": _paper,
    ".onnx": read_package,
    ".mcap": read_run_log,
}
