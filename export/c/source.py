"""A program as text: the header that a caller includes, and the one source file."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from export.c.kernels import needed
from export.c.program import Program, StateMember
from export.c.values import literal
from export.c.weights import Kind, constants
from wakedeploy.core.manifest import Manifest

_INDENT = "    "
_PLACE = re.compile("\x01([^\x02]*)\x02")


@dataclass(frozen=True)
class Model:
    """What the files of a folder are written from."""

    name: str
    program: Program
    manifest: Manifest
    kind: Kind
    package_sha256: str


def _memory(manifest: Manifest) -> str:
    """From when on the force counts, and what an input spoils that is no number."""
    steps = manifest.warm_up_steps
    if manifest.memory.kind == "state":
        return f"""\
   Do not use the force before step {steps}: its errors were measured from there on. Its state goes
   on to carry what came before, for ever less.
   An input outside its range gives a force that means nothing; one that is not finite stays in the
   state: leave it out, or call reset."""
    return f"""\
   Before step {steps} its memory is not full: do not use the force.
   An input that is not finite, or outside its range, gives a force that means nothing."""


def header(model: Model) -> str:
    """The header: state, reset and step, with units and ranges of every channel."""
    name, manifest = model.name, model.manifest
    guard = f"{name.upper()}_H"
    seconds = f"{manifest.lead_s:g} s ahead of" if manifest.lead_s else "at the time of"
    return f"""\
/* {manifest.arch} for {_plain(manifest.domain)}: the force {seconds} the newest observation.
   Made by wakedeploy; do not edit. README.md beside it says how it was proved and what it takes.

   A step is due every {1.0 / manifest.rate_hz:.9g} s ({manifest.rate_hz:g} Hz).
{_memory(manifest)}
{_weights(model)}

   observation, with the range seen in training:
{_channels(manifest.observation)}{_filters(manifest)}
   force, with the limits beyond which none is given:
{_limits(manifest)}
*/
#ifndef {guard}
#define {guard}

#include <stdint.h>

#ifdef __cplusplus
extern "C" {{
#endif

#define {name.upper()}_INPUTS {len(manifest.observation)}
#define {name.upper()}_OUTPUTS {len(manifest.force)}
#define {name.upper()}_WARM_UP_STEPS {manifest.warm_up_steps}
#define {name.upper()}_RATE_HZ {literal(manifest.rate_hz)}
#define {name.upper()}_LEAD_S {literal(manifest.lead_s)}

typedef struct {{
{_members(model.program.members)}
}} {name}_state;

/* Forget everything; also what makes a state usable at first. */
void {name}_reset({name}_state *state);

/* One step. Every channel is in the unit that is stated above. */
void {name}_step({name}_state *state, const float observation[{len(manifest.observation)}],
{" " * len(f"void {name}_step(")}float force[{len(manifest.force)}]);

/* SHA-256 of the package that this was made from, and all that it says about itself, as JSON. A
   linker that drops unused sections drops them. */
extern const char {name}_package_sha256[65];
extern const char {name}_manifest[];

#ifdef __cplusplus
}}
#endif

#endif
"""


def _weights(model: Model) -> str:
    """How the weights are kept, of the matrices by their names."""
    matrices = model.program.matrices
    exact = [m.name for m in matrices if m.kept(model.kind) != model.kind]
    beside = f"; {', '.join(exact)} and all biases are float32" if exact else ""
    return f"   Weights are {model.kind}{beside}."


def source(model: Model, document: str) -> str:
    """The source; `document` is the JSON that it carries."""
    name, program = model.name, model.program
    body = step_body(program)
    functions = "\n".join(needed(body, model.kind))
    declared = "\n".join(_constants(program, model.kind, body))
    reset = _INDENT + f"\n{_INDENT}".join(_reset_lines(program.members))
    rooms = "".join(f"{_INDENT}float {room}[{size}];\n" for room, size in program.rooms.items())
    return f"""\
/* Made by wakedeploy; do not edit. C99, no heap, nothing but <math.h>. */
#include "{name}.h"

#include <math.h>

/* Where constants stay in flash only if a pointer says so: AVR, and gcc with its GNU dialect. */
#if defined(__FLASH)
#define FLASH __flash
#else
#define FLASH
#endif

typedef char float_has_32_bits[sizeof(float) == 4 ? 1 : -1];
typedef char state_has_its_size[sizeof({name}_state) == {program.state_bytes} ? 1 : -1];

{declared}
{functions}
void {name}_reset({name}_state *state)
{{
{reset}
}}

void {name}_step({name}_state *state, const float observation[{len(model.manifest.observation)}],
{" " * len(f"void {name}_step(")}float force[{len(model.manifest.force)}])
{{
{rooms}{_used(body)}{body}
}}

const char {name}_package_sha256[65] =
    "{model.package_sha256}";

const char {name}_manifest[] =
{_quoted(document)};
"""


def _used(body: str) -> str:
    return "" if "state->" in body else f"{_INDENT}(void)state;\n"


def step_body(program: Program) -> str:
    """The statements of the step, with the names that everything has in C."""
    places = {store.name: place for store, place in program.places.items()}
    lines = [line for statement in program.statements for line in statement.lines]
    text = "\n".join(_INDENT + line for line in lines)
    return _PLACE.sub(lambda found: places[found[1]], text)


def _constants(program: Program, kind: Kind, body: str) -> list[str]:
    """What the step names; a table that it does not name is left away."""
    words = set(re.findall(r"[A-Za-z_]\w*", body))
    tables = [
        constants(f"{name}[{values.size}]", values)
        for name, values in program.tables.items()
        if name in words
    ]
    matrices = [text for matrix in program.matrices for text in matrix.declarations(kind)]
    starts = [
        constants(f"{member.name}_start[{member.size}]", member.initial)
        for member in program.members
        if member.initial is not None and len(set(member.initial.tolist())) > 1
    ]
    return [*tables, *matrices, *starts]


def _members(members: Sequence[StateMember]) -> str:
    if not members:
        return f"{_INDENT}int32_t nothing; /* it has no memory */"
    lines = []
    for member in members:
        kind = f"float {member.name}[{member.size}]" if member.size else f"int32_t {member.name}"
        comment = f" /* {member.what} */" if member.what and member.what != member.name else ""
        lines.append(f"{_INDENT}{kind};{comment}")
    return "\n".join(lines)


def _reset_lines(members: Sequence[StateMember]) -> list[str]:
    if not members:
        return ["state->nothing = 0;"]
    lines = []
    for member in members:
        if not member.size:
            lines.append(f"state->{member.name} = 0;")
            continue
        assert member.initial is not None
        first = literal(float(member.initial[0]))
        is_one = len(set(member.initial.tolist())) == 1
        value = first if is_one else f"{member.name}_start[i]"
        lines += [
            f"for (int i = 0; i < {member.size}; ++i) {{",
            f"{_INDENT}state->{member.name}[i] = {value};",
            "}",
        ]
    return lines


def _channels(channels: Sequence[object]) -> str:
    return "\n".join(
        f"     {i}  {c.name} [{_plain(c.unit)}], {c.min:.6g} to {c.max:.6g}"  # type: ignore[attr-defined]
        for i, c in enumerate(channels)
    )


def _filters(manifest: Manifest) -> str:
    """What to do to inputs before a step; nothing where they were learnt from as they came."""
    filtered = [c for c in manifest.observation if c.filtered]
    if not filtered:
        return ""
    lines = "\n".join(f"     {c.name}: {_plain(c.filtered)}" for c in filtered)
    return f"\n   filter these likewise before each step, as they were in training:\n{lines}"


def _limits(manifest: Manifest) -> str:
    return "\n".join(
        f"     {i}  {c.name} [{_plain(c.unit)}], {c.low:.6g} to {c.high:.6g}"
        for i, c in enumerate(manifest.force)
    )


def _plain(text: str) -> str:
    """A text of the manifest as it may stand in a comment."""
    safe = text.encode("ascii", "replace").decode().replace("?/", "?")
    return safe.replace("*/", "* /").replace("/*", "/ *").replace("\\", "/")


def _quoted(document: str) -> str:
    """An ASCII text as string literals of a line each."""
    safe = document.replace("\\", "\\\\").replace('"', '\\"').replace("?", "\\?")
    pieces = re.findall(r"(?:\\.|[^\\]){1,90}", safe)
    return "\n".join(f'{_INDENT}"{piece}"' for piece in pieces)
