"""A rig's model as files for elsewhere: a plain Python module and a MATLAB script.

In: a rig, its effects included. Out: `gantry_model.py` (needs numpy alone) and `gantry_model.m`
(MATLAB or Octave), which compute the same from the same text: `gantry_model`, the functions that
the simulation calls, and the effects' own methods.
"""

import ast
import inspect
import textwrap
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from wakedeploy.core.files import write_text_whole
from wakedeploy.core.rig import Rig
from wakedeploy.core.version import VERSION
from wakedeploy.gap.model_export import gantry_model as export_model
from wakedeploy.gap.model_export import matlab
from wakedeploy.gap.model_export.effects import (
    acting_name,
    combining_functions,
    effect_functions,
    is_acting,
    stage_functions,
)
from wakedeploy.physics.constants import constants_of, with_constants
from wakedeploy.physics.effects.acting import LEAST_MOTION_MPS, TAKEN_OFF
from wakedeploy.physics.effects.base import Effect
from wakedeploy.physics.effects.chain import Chain, setting_of
from wakedeploy.physics.effects.symbolic import ExpressionForce
from wakedeploy.physics.gantry import INNER_RATE_HZ
from wakedeploy.physics.jet import puff_count

NAME = "gantry_model"
_FROM, _TO = "# exported from here on\n", "# exported up to here\n"

Constant = float | tuple[float, ...] | Mapping[str, float]


def export_rig(rig: Rig, folder: Path) -> tuple[Path, Path]:
    """Write both forms of a rig's model into a folder; the files' paths, Python's first.

    Raises UnusableInput for an effect whose methods cannot be written in both languages.
    """
    python, script = python_module(rig), matlab_script(rig)
    paths = folder / f"{NAME}.py", folder / f"{NAME}.m"
    write_text_whole(paths[0], python)
    write_text_whole(paths[1], script)
    return paths


def python_module(rig: Rig) -> str:
    """The model as the text of a Python module with `simulate`."""
    chain = Chain.of(rig)
    parts = [
        f'"""{_title(rig)}\n\n{_about(chain, "simulate")}\n"""',
        "from types import SimpleNamespace\nfrom typing import Any\n\nimport numpy as np",
        _python_constants(_constants(rig, chain)),
        *(ast.unparse(function) for function in stage_functions()),
        *(ast.unparse(function) for function in effect_functions(chain)),
        *(ast.unparse(function) for function in combining_functions(chain)),
        _core_text().strip(),
    ]
    return "\n\n\n".join(parts) + "\n"


def matlab_script(rig: Rig) -> str:
    """The model as the text of a MATLAB function file `gantry_model.m`."""
    chain = Chain.of(rig)
    core = [
        statement
        for statement in ast.parse(_core_text()).body
        if isinstance(statement, ast.FunctionDef)
    ]
    (main,) = (function for function in core if function.name == "simulate")
    main.name = NAME
    others = [function for function in core if function is not main]
    about = f"{_title(rig)}\n\n{_about(chain, NAME)}"
    first, *rest = matlab.function(main).splitlines()
    comments = [f"  % {line}".rstrip() for line in about.splitlines()]
    parts = [
        "\n".join([first, *comments, "  %", *rest]) + "\n",
        _matlab_constants(_constants(rig, chain)),
        *(matlab.function(function) for function in stage_functions()),
        *(matlab.function(function) for function in effect_functions(chain)),
        *(matlab.function(function) for function in combining_functions(chain)),
        *(matlab.function(function) for function in others),
    ]
    return "\n".join(parts) + matlab.HELPERS


def _core_text() -> str:
    """The part of `gantry_model` between its two marks."""
    text = inspect.getsource(export_model)
    return text[text.index(_FROM) + len(_FROM) : text.index(_TO)]


def _title(rig: Rig) -> str:
    return f"The gantry's model, exported from rig {rig.sha256[:12]} by wakedeploy."


def _about(chain: Chain, function: str) -> str:
    """What the file holds, and which effects act in it."""
    lines = [
        f"Written by wakedeploy {VERSION}. SI units, pulse widths in us.",
        f"Call {function}(t_s, source_us, sufferer_us, x_m); constants() holds every number.",
    ]
    if chain.parts:
        lines += ["", "Effects, in the order in which they act:"]
        lines += [line for effect, p in chain.parts for line in _described(effect, p)]
    return "\n".join(lines)


def _described(effect: Effect, values: Mapping[str, float]) -> list[str]:
    units = {p.name: "" if p.unit == "1" else f" {p.unit}" for p in effect.parameters}
    shown = ", ".join(f"{name} = {value:g}{units[name]}" for name, value in values.items())
    lines = [f"- {effect.name}: {shown}", *textwrap.wrap(effect.physics, 94)]
    if isinstance(effect, ExpressionForce):
        lines += textwrap.wrap(effect.formula.text, 94)
    return [lines[0], *(f"  {line}" for line in lines[1:])]


def _constants(rig: Rig, chain: Chain) -> dict[str, Constant]:
    """Every number of the model by the name it has there, effects' values as records."""
    moved = chain.constants(constants_of(rig))
    plain = with_constants(rig, moved)
    made: dict[str, Constant] = {}
    for motor in ("source", "sufferer"):
        curve, lag = getattr(plain.thrust, motor), getattr(plain.spool, motor)
        made |= {f"{motor}_us": curve.pulse_us, f"{motor}_n": curve.thrust_n}
        made[f"{motor}_lag"] = dict(lag)
    made |= vars(setting_of(plain)) | _of_sections(plain)
    made |= {
        "command_delay_s": moved["command.delay_s"],
        "range_bias_m": moved["range.bias_m"],
        "range_scale": moved["range.scale"],
        "range_delay_s": moved["range.delay_s"],
        "range_hold_s": moved["range.hold_s"],
    }
    acting = {acting_name(effect): dict(p) for effect, p in chain.parts if is_acting(effect)}
    return made | acting


def _of_sections(rig: Rig) -> dict[str, Constant]:
    wake, rail = rig.wake, rig.rail
    life_s = puff_count(wake, 1.0 / INNER_RATE_HZ, rig.source.height_m) / INNER_RATE_HZ
    return {
        "idle_us": rig.limits.pulse_us[0],
        "esc_frame_s": rig.disturbance.esc_frame_s,
        "wake": dict(wake),
        "wake_life_s": life_s,
        "rail": dict(rail),
        "range_period_s": rig.range_sensor.period_s,
        "readout_delay_s": 0.5 * rig.latency.round_trip_s,
        "least_motion_mps": LEAST_MOTION_MPS,
        "taken_off_share": TAKEN_OFF,
    }


def _python_constants(constants: Mapping[str, Constant]) -> str:
    lines = ["def constants() -> Any:", '    """The rig\'s constants and its effects\' values."""']
    lines += ["    c = SimpleNamespace()"]
    for name, value in constants.items():
        if isinstance(value, Mapping):
            inner = ", ".join(f"{key}={_number(number)}" for key, number in value.items())
            lines.append(f"    c.{name} = SimpleNamespace({inner})")
        elif isinstance(value, tuple):
            lines.append(f"    c.{name} = np.array([{', '.join(map(_number, value))}])")
        else:
            lines.append(f"    c.{name} = {_number(value)}")
    return "\n".join([*lines, "    return c"])


def _matlab_constants(constants: Mapping[str, Constant]) -> str:
    lines = ["function c = constants()", "  % the rig's constants and its effects' values"]
    lines += ["  c = struct();"]
    for name, value in constants.items():
        if isinstance(value, Mapping):
            lines += [f"  c.{name}.{key} = {_number(number)};" for key, number in value.items()]
        elif isinstance(value, tuple):
            lines.append(f"  c.{name} = [{', '.join(map(_number, value))}];")
        else:
            lines.append(f"  c.{name} = {_number(value)};")
    return "\n".join([*lines, "end"]) + "\n"


def _number(value: float) -> str:
    """The shortest text that reads back to the same double."""
    return repr(float(np.float64(value)))
