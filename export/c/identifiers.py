"""Names that C and C++ accept, from names of tensors."""

import re

from wakedeploy.core.errors import UnusableInput

_LONGEST = 31  # letters that C99 tells apart in a name with external linkage
# fmt: off
_RESERVED = frozenset((
    "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else",
    "enum", "extern", "float", "for", "goto", "if", "inline", "int", "long", "register",
    "restrict", "return", "short", "signed", "sizeof", "static", "struct", "switch", "typedef",
    "union", "unsigned", "void", "volatile", "while", "bool", "catch", "class", "delete",
    "explicit", "export", "false", "friend", "mutable", "namespace", "new", "operator", "private",
    "protected", "public", "template", "this", "throw", "true", "try", "typename", "using",
    "virtual", "and", "or", "not", "xor", "main", "dense", "sparse", "sigmoid", "softplus",
    "softmax", "layer_norm", "state", "observation", "force", "exp", "tanh", "sqrt", "expf",
    "tanhf", "sqrtf", "log1pf", "powf", "few", "frame", "sum", "matrix", "scale", "bias", "columns",
    "counts", "FLASH", "AS_WRITTEN",
))
# `#include <math.h>` must not find the model's own header, here or in the caller's program.
_HEADERS = frozenset((
    "assert", "complex", "ctype", "errno", "fenv", "float", "inttypes", "iso646", "limits",
    "locale", "math", "setjmp", "signal", "stdalign", "stdarg", "stdatomic", "stdbool", "stddef",
    "stdint", "stdio", "stdlib", "stdnoreturn", "string", "tgmath", "threads", "time", "uchar",
    "wchar", "wctype",
))
# fmt: on
_OF_THE_SELF_TEST = "_test"  # NAME_test.c lies beside NAME.c
_OF_THE_MODEL = re.compile(r"^(predictor\.core\.|predictor\.|core\.)")


def require_name(name: str) -> str:
    """A name that the user chose for the C functions; UnusableInput where C would not take it."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name) or len(name) + len("_manifest") > _LONGEST:
        raise UnusableInput(
            f"'{name}' is no name for C functions; give --name letters, digits and underscores,"
            f" {_LONGEST - len('_manifest')} at most, a letter first."
        )
    if name in _RESERVED:
        raise UnusableInput(f"'{name}' means something else in C; give another --name.")
    if name.lower() in _HEADERS:
        raise UnusableInput(
            f"'{name}.h' would hide the header <{name.lower()}.h> of C; give another --name."
        )
    if name.endswith(_OF_THE_SELF_TEST):
        raise UnusableInput(
            f"'{name}' ends in {_OF_THE_SELF_TEST}, as the self-test's file does; give another"
            " --name."
        )
    return name


class Names:
    """Hands out names, each once; hostile ones lose what C does not take."""

    def __init__(self) -> None:
        self._taken: set[str] = set(_RESERVED)

    def new(self, wish: str) -> str:
        """A name like `wish` that nothing has yet."""
        plain = re.sub(
            r"[^A-Za-z0-9]+", "_", _OF_THE_MODEL.sub("", wish.replace("next_state_", "next_"))
        ).strip("_")
        plain = plain[:40] or "value"
        plain = plain if plain[0].isalpha() else f"v_{plain}"
        name, number = plain, 1
        while name in self._taken:
            number += 1
            name = f"{plain}_{number}"
        self._taken.add(name)
        return name
