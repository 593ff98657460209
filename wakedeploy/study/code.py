"""Which code made something: a hash over the source of a module and of all that it imports.

Of the two ways to notice that a simulator has changed, a number that somebody has to raise and a
hash of the source, this is the one that cannot be forgotten. It is too careful: the edit of a
comment counts. But a set is made again in minutes, and where only a comment changed it is the same
set, so that what was trained on it is used again. For trained runs, which take hours, see
`TRAINING` in `trainers.training.runs`.
"""

import ast
import functools
import hashlib
import importlib.util
from pathlib import Path

import wakedeploy

_ROOT = Path(wakedeploy.__file__).parents[1]


@functools.cache
def code_sha256(module: str) -> str:
    """Hash over the files of a module and of those of this project, and its own, that it imports.

    At any depth; imports inside functions count. Raises ValueError for a module that is not there.
    """
    beside = _beside(module)
    if _file(module, beside) is None:
        raise ValueError(f"{module} is no module of this project, nor of a package that adds to it")
    files, waiting = dict[str, bytes](), [module]
    while waiting:
        name = waiting.pop()
        path = _file(name, beside)
        if path is not None and name not in files:
            files[name] = path.read_bytes()
            waiting += _imported(files[name])
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(f"{name} {hashlib.sha256(files[name]).hexdigest()}\n".encode())
    return digest.hexdigest()


def _beside(module: str) -> tuple[str, Path] | None:
    """The package of a module that another one adds to this project, and where it lies."""
    package = module.partition(".")[0]
    spec = importlib.util.find_spec(package)
    if (_ROOT / package).is_dir() or spec is None or spec.origin is None:
        return None
    return package, Path(spec.origin).parents[1 if spec.submodule_search_locations else 0]


def _file(module: str, beside: tuple[str, Path] | None) -> Path | None:
    parts = module.split(".")
    root = beside[1] if beside is not None and beside[0] == parts[0] else _ROOT
    place = root.joinpath(*parts)
    return next((p for p in (place.with_suffix(".py"), place / "__init__.py") if p.is_file()), None)


def _imported(source: bytes) -> list[str]:
    """What a file imports; names from a package may be its modules."""
    found = list[str]()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            found += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return found
