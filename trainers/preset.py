"""Presets: an architecture's hyper-parameters and fit settings as a small TOML file.

`wakedeploy tune` writes one for the best that it found, `wakedeploy train --preset` trains with it.
Those that ship lie in `presets/<domain>/<arch>.toml`.
"""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import tomli_w
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from trainers.bounds import check_settings
from trainers.build import hyper_parameters
from trainers.training.fit import FitSettings
from trainers.training.runs import LONGEST_LEAD_S
from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.files import at_home, text_of, toml_of, write_text_whole
from wakedeploy.core.validation import first_problem

SHIPPED = Path(__file__).with_name("presets")
REFERENCE, TUNED = "reference", "tuned"  # the paper's shapes, and those that ship


class Preset(BaseModel):
    """What to train with; `study` says where it comes from and changes nothing."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    format: Literal[1] = 1
    arch: str
    hyper: dict[str, int | float]
    settings: dict[str, int | float]
    study: dict[str, Any] = Field(default_factory=dict)

    @field_validator("study")
    @classmethod
    def _lead_is_a_time(cls, study: dict[str, Any]) -> dict[str, Any]:
        lead_s = study.get("lead_s", 0.0)
        if not isinstance(lead_s, int | float) or not 0 <= lead_s <= LONGEST_LEAD_S:
            raise ValueError(f"lead_s has to be a number from 0 to {LONGEST_LEAD_S:g}")
        return study


def read_preset(path: Path) -> Preset:
    """Read and check a preset; UnusableInput names the file and what is wrong in it."""
    try:
        preset = Preset.model_validate(toml_of(text_of(path)))
        hyper_parameters(preset.arch, preset.hyper)
        check_settings(dataclasses.asdict(FitSettings()), preset.settings)
    except FileNotFoundError as error:
        raise UnusableInput(
            f"{path} does not exist; give a preset's file, 'reference' or 'tuned'."
        ) from error
    except ValidationError as error:
        raise UnusableInput(f"{path} is no preset: {first_problem(error)}.") from error
    except UnusableInput as error:
        raise UnusableInput(f"{path}: {error}") from error
    except (OSError, ValueError) as error:  # TOML's and UTF-8's own are ValueErrors
        raise UnusableInput(f"{path} cannot be read as a preset ({one_line(error)}).") from error
    return preset


def chosen_preset(asked: str, arch: str, domain: str) -> Preset | None:
    """What `asked`, reference, tuned or a file, means for an architecture on sets of a domain.

    None for the reference, from which a preset differs. UnusableInput where there is none.
    """
    if asked == REFERENCE:
        return None
    chosen = shipped_preset(domain, arch) if asked == TUNED else read_preset(at_home(Path(asked)))
    if chosen.arch != arch:
        raise UnusableInput(
            f"{asked} is a preset of {chosen.arch}, not of {arch}; train --arch {chosen.arch} with"
            " it."
        )
    return chosen


def shipped_preset(domain: str, arch: str) -> Preset:
    """The tuned preset that ships for an architecture on a domain; UnusableInput without one."""
    path = SHIPPED / domain / f"{arch}.toml"
    if not path.is_file():
        raise UnusableInput(
            f"No tuned preset of {arch} ships for {domain} sets; find one with `wakedeploy tune"
            f" --arch {arch}` and give its best.toml, or use --preset reference."
        )
    return read_preset(path)


def write_preset(path: Path, preset: Preset, heading: str) -> None:
    """Write a preset whole, `heading` as a comment above it."""
    text = tomli_w.dumps(preset.model_dump())
    write_text_whole(path, f"# {heading}\n{text}")


def stated(values: Mapping[str, Any]) -> dict[str, int | float]:
    """What TOML can say of some settings: those that leave the choice to the set are left out."""
    return {name: value for name, value in values.items() if value is not None}
