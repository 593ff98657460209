"""A package as C, compiled for this machine and stepped, without the folder around it."""

import ctypes
import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from export.c.lowering import lowered
from export.c.source import Model, header, source
from runtime.compiled.compiler import compiled
from wakedeploy.core.onnx_graph import read_graph

_number = itertools.count()
_compiled: dict[tuple[bytes, tuple[str, ...]], bytes] = {}  # libraries by their source and flags


def model_of(package, kind="float32", name="model") -> Model:
    program = lowered(read_graph(package.model_bytes), package.manifest, kind)
    return Model(name, program, package.manifest, kind, package.sha256)


def written(model: Model, folder: Path) -> Path:
    """Header and source in a folder; the source's path."""
    path = folder / f"{model.name}.c"
    path.with_suffix(".h").write_text(header(model), encoding="utf-8")
    path.write_text(source(model, model.manifest.model_dump_json()), encoding="utf-8")
    return path


class Stepped:
    """One series, from a reset."""

    def __init__(self, model: Model, folder: Path, flags: Sequence[str] = ("-O2",)) -> None:
        path = written(model, folder)
        out = folder / f"{model.name}-{next(_number)}.so"  # a loaded name is never loaded again
        made = _compiled.get((text := path.read_bytes(), tuple(flags)))
        if made is None:
            compiled([path], out, (*flags, "-shared", "-fPIC"))
            _compiled[text, tuple(flags)] = out.read_bytes()
        else:
            out.write_bytes(made)
        library = ctypes.CDLL(str(out))
        self._step, self._reset = (getattr(library, f"{model.name}_{w}") for w in ("step", "reset"))
        self._state = np.zeros(model.program.state_bytes // 4, np.float32)
        self._outputs = len(model.manifest.force)
        self.reset()

    def reset(self) -> None:
        self._reset(self._state.ctypes.data_as(ctypes.c_void_p))

    def rollout(self, observations) -> np.ndarray:
        """Forces (T, o) for observations (T, d), going on from where it stands."""
        given = np.ascontiguousarray(observations, np.float32)
        forces = np.zeros((len(given), self._outputs), np.float32)
        for now, force in zip(given, forces, strict=True):
            places = (array.ctypes.data_as(ctypes.c_void_p) for array in (self._state, now, force))
            self._step(*places)
        return forces
