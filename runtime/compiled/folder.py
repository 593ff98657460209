"""What `wakedeploy export --c` writes, read again: four files that belong together."""

import re
import shlex
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from runtime.compiled.driven import driven
from wakedeploy.core.errors import UnusableInput, why
from wakedeploy.core.files import sha256_of
from wakedeploy.core.manifest import FloatArray, Manifest, Sha256
from wakedeploy.core.validation import first_problem

SCHEMA = 1
MOST_BYTES = 1 << 28  # of a source: the text of the largest package
_DOCUMENT = re.compile(rb"\nconst char \w+_manifest\[\] =\n((?:    \"[^\n]*\"\n?)+);\n\Z")
_SEAL = "/* SHA-256 of everything above: {} */\n"
_ESCAPED = re.compile(r"\\(.)")
_REMAKE = "export it again with `wakedeploy export --c`"
_ALTERED = f"altered or damaged since it was exported; copy it again, or {_REMAKE}"


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Proof(_Record):
    """One build that was held against the training-time forward, and the worst difference."""

    compiler: str
    flags: str
    max_rel: Annotated[float, Field(ge=0)]


class Rounding(_Record):
    """What rounded weights change, measured on `on`.

    `rmse` is that of the rounded model, `float_rmse` that of the trained one, per force channel in
    its unit; where the true force is not known both are null. `rel_rms` is the root mean square of
    what changed over that of the force's own deviation from its mean, of the worst channel.
    """

    on: str
    rel_rms: Annotated[float, Field(ge=0)]
    rmse: dict[str, float] | None = None
    float_rmse: dict[str, float] | None = None

    @property
    def worse(self) -> float | None:
        """By which share the error grows, of the worst channel."""
        if self.rmse is None or self.float_rmse is None:
            return None
        return max(
            self.rmse[name] / (error or 1.0) - 1.0 for name, error in self.float_rmse.items()
        )


class Document(_Record):
    """What a C folder says about itself, as JSON within its source."""

    schema_version: Annotated[int, Field(alias="schema", ge=SCHEMA, le=SCHEMA)] = SCHEMA
    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,30}$")]
    weights: Literal["float32", "float16", "int8"]
    package_sha256: Sha256
    header_sha256: Sha256
    test_sha256: Sha256
    state_bytes: Annotated[int, Field(ge=4)]
    stack_bytes: Annotated[int, Field(ge=0)]  # of the step's own arrays
    weight_bytes: Annotated[int, Field(ge=0)]
    steps: Annotated[int, Field(ge=1)]
    limit: Annotated[float, Field(gt=0)]
    reference: str
    proofs: tuple[Proof, ...]
    rounding: Rounding | None
    manifest: Manifest


@dataclass(frozen=True)
class CFolder:
    """A predictor in C: where it lies and what it says about itself."""

    path: Path
    document: Document

    @property
    def manifest(self) -> Manifest:
        """That of the package that it was made from."""
        return self.document.manifest

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the source, which run logs record."""
        return sha256_of(self.source.read_bytes())

    @property
    def source(self) -> Path:
        """The C file."""
        return self.path / f"{self.document.name}.c"

    @property
    def test(self) -> Path:
        """The self-test."""
        return self.path / f"{self.document.name}_test.c"

    @property
    def inputs(self) -> FloatArray:
        """Observations (T, d) to try it with, which are nobody's recording."""
        return driven(self.manifest, 512)


# What a run's folder holds, as trainers.training.runs has it, which loads torch.
RUN_FILES = ("config.json", "best.safetensors")


def read_c_folder(path: Path | str) -> CFolder:
    """Read and validate a folder; UnusableInput where files are missing, foreign or altered."""
    path = Path(path)
    if all((path / name).is_file() for name in RUN_FILES):
        raise UnusableInput(
            f"{path}: is the folder of a run; make a package of it by `wakedeploy export --run"
            f" {shlex.quote(str(path))}`, and name that."
        )
    found = [p for p in sorted(path.glob("*.c")) if not p.stem.endswith("_test")]
    if len(found) != 1:
        sources = "no C source" if not found else f"{len(found)} C sources"
        raise UnusableInput(
            f"{path}: a folder with {sources}, where one made by `wakedeploy export --c` has one;"
            " name such a folder, or a package's file."
        )
    text = _unsealed(found[0])
    match = _DOCUMENT.search(text[-(1 << 20) :])
    if match is None:
        raise UnusableInput(f"{found[0]}: not made by this release of wakedeploy; {_REMAKE}")
    folder = CFolder(path, _document(match[1].decode("ascii", "replace"), found[0]))
    _require_own(folder, found[0])
    return folder


def sealed(source: str) -> str:
    """A source with a last line that damage to any other does not fit."""
    return source + _SEAL.format(sha256_of(source.encode()))


def _unsealed(path: Path) -> bytes:
    """A source without that line; UnusableInput where it is not there or does not fit."""
    text = _bytes(path)
    body = text[: -len(_SEAL.format("0" * 64))]
    seal = text[len(body) :].decode("ascii", "replace")
    if not seal.startswith(_SEAL.partition("{")[0]):
        raise UnusableInput(f"{path}: not made by wakedeploy, or cut off; {_REMAKE}")
    if seal != _SEAL.format(sha256_of(body)):
        raise UnusableInput(f"{path}: {_ALTERED}")
    return body


def _document(literals: str, path: Path) -> Document:
    lines = [line.strip()[1:-1] for line in literals.splitlines()]
    text = _ESCAPED.sub(r"\1", "".join(lines))
    try:
        return Document.model_validate_json(text)
    except ValidationError as error:
        raise UnusableInput(f"{path}: manifest: {first_problem(error)}; {_REMAKE}") from error


def _require_own(folder: CFolder, source: Path) -> None:
    """Refuse files that are not those which were written together."""
    document = folder.document
    if source.stem != document.name:
        raise UnusableInput(f"{source}: says that it is {document.name}.c; {_REMAKE}")
    stated = {
        source.with_suffix(".h"): document.header_sha256,
        folder.test: document.test_sha256,
    }
    for path, expected in stated.items():
        if sha256_of(_bytes(path)) != expected:
            raise UnusableInput(f"{path}: {_ALTERED}")


def _bytes(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise UnusableInput(f"{path}: cannot be read ({why(error)}); {_REMAKE}") from error
    if len(content) > MOST_BYTES:
        raise UnusableInput(f"{path}: larger than any that wakedeploy writes; {_REMAKE}")
    return content
