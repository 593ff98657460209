"""What was found, as a small TOML file that a system loads: `MyRobot.corrected("correction.toml")`.

In: a fit and its model. Out: constants as it has them, effects with their parameters, and the
usual sizes from the log, which smooth signs and shapes need.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import pydantic

from wakedeploy.core.errors import UnusableInput, why
from wakedeploy.core.files import text_of, toml_of, write_text_whole
from wakedeploy.core.validation import first_problem

if TYPE_CHECKING:
    from wakedeploy.gap.evidence.fits import Fit
    from wakedeploy.gap.systems.likelihood.logs import LogModel

VERSION = 6
_ENDS = ("lowest ", "highest ", "top ", "bottom ")
_Finite = Annotated[float, pydantic.Field(allow_inf_nan=False)]


class _Table(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid", frozen=True)


class Named(_Table):
    """An effect, its parameters by name, and their units."""

    name: str
    parameters: dict[str, _Finite]
    units: dict[str, str]


class Document(_Table):
    """The file."""

    version: int
    system: str
    sample_s: Annotated[float, pydantic.Field(gt=0)]
    span_s: Annotated[float, pydantic.Field(gt=0)]
    constants: dict[str, _Finite] = {}
    clocks_s: dict[str, _Finite] = {}  # by which inputs act later than their stamps
    form: dict[str, _Finite] = {}
    sizes: dict[str, _Finite]
    effect: tuple[Named, ...] = ()

    @pydantic.field_validator("sizes")
    @classmethod
    def _positive(cls, sizes: dict[str, float]) -> dict[str, float]:
        """All but the ends of a way, and of what a sensor showed, are from 0."""
        for name, size in sizes.items():
            if size < 0.0 and not name.startswith(_ENDS):
                raise ValueError(f"the size of {name} is {size:g}, below 0")
        return sizes


@dataclass(frozen=True)
class Correction:
    """A correction of a system: values by the names that a fit has for them."""

    document: Document

    @property
    def is_empty(self) -> bool:
        """Whether it leaves the system as it is."""
        return not self.document.effect and not self.document.constants

    @property
    def effects(self) -> tuple[str, ...]:
        """The effects that act."""
        return tuple(e.name for e in self.document.effect)

    @property
    def values(self) -> dict[str, float]:
        """Constants, clocks, the form term and the effects' parameters."""
        values = {f"constant.{n}": v for n, v in self.document.constants.items()}
        values |= {f"clock.{n}": v for n, v in self.document.clocks_s.items()}
        values |= {f"form.{n}": v for n, v in self.document.form.items()}
        for effect in self.document.effect:
            values |= {f"{effect.name}.{n}": v for n, v in effect.parameters.items()}
        return values


def correction_of(model: "LogModel", fitted: "Fit") -> Correction:
    """What a fit says, without its noise; of one without effects what nobody knew before.

    Constants that are refitted alone follow the logs' noise, or bend to what is missing; but any
    fit knows more of those that nobody has measured.
    """
    values = dict(zip(fitted.names, map(float, fitted.theta), strict=True))
    constants, form = _below(values, "constant."), _below(values, "form.")
    clocks_s = {i.name: values[f"clock.{model.clocked(i.name)}"] for i in model.system.logged}
    if not fitted.hypothesis:
        spreads = {c.name: c.spread for c in model.system.constants}
        constants = {n: v for n, v in constants.items() if np.isinf(spreads[n])}
        form, clocks_s = {}, {}
    document = Document(
        version=VERSION,
        system=model.system.name,
        sample_s=model.dt_s,
        span_s=model.span_s,
        constants=constants,
        clocks_s=clocks_s,
        form=form,
        sizes=dict(model.sizes),
        effect=tuple(_named(n, values, fitted) for n in fitted.hypothesis),
    )
    return Correction(document)


def _named(name: str, values: Mapping[str, float], fitted: "Fit") -> Named:
    units = {f.name: f.unit for f in fitted.free}
    parameters = _below(values, f"{name}.")
    return Named(
        name=name, parameters=parameters, units={n: units[f"{name}.{n}"] for n in parameters}
    )


def write_correction(correction: Correction, path: Path) -> None:
    """As TOML, for a person to read and a system to load."""
    document = correction.document
    lines = [
        "# What the logs say about the system; `System.corrected` loads it.",
        f"version = {document.version}",
        f'system = "{document.system}"',
        f"sample_s = {document.sample_s!r}",
        f"span_s = {document.span_s!r}",
    ]
    for effect in document.effect:
        lines += ["", "[[effect]]", f'name = "{effect.name}"']
        lines += ["[effect.parameters]", *_lines(effect.parameters)]
        lines += ["[effect.units]", *(f'"{n}" = "{unit}"' for n, unit in effect.units.items())]
    for title, values in (
        ("constants", document.constants),
        ("clocks_s", document.clocks_s),
        ("form", document.form),
        ("sizes", document.sizes),
    ):
        lines += ["", f"[{title}]", *_lines(values)]
    write_text_whole(path, "\n".join(lines) + "\n")


def read_correction(path: Path, system: str) -> Correction:
    """A correction for the system of this name.

    Raises UnusableInput for a file that is absent, damaged, or of another system.
    """
    try:
        table = toml_of(text_of(path))
        if not {"system", "sizes"} & table.keys():  # as of a columns.toml
            raise UnusableInput(
                f"{path} is no correction; give the correction.toml that `gap close` or `gap add` "
                "wrote for this system into its --out."
            )
        document = Document.model_validate(table)
    except pydantic.ValidationError as error:
        raise UnusableInput(f"{path}: {first_problem(error)}.") from error
    except (OSError, ValueError) as error:
        raise UnusableInput(f"{path}: {why(error)}; `gap add` writes a correction.") from error
    if document.version != VERSION:
        raise UnusableInput(f"{path}: version {document.version}; this program reads {VERSION}.")
    if document.system != system:
        raise UnusableInput(f"{path} corrects {document.system!r}, not {system!r}; give its own.")
    return Correction(document)


def _below(values: Mapping[str, float], prefix: str) -> dict[str, float]:
    return {n.removeprefix(prefix): float(v) for n, v in values.items() if n.startswith(prefix)}


def _lines(values: Mapping[str, float]) -> list[str]:
    return [f'"{name}" = {value!r}' for name, value in values.items()]
