"""Code for engines in a neutral form, and its translation to any of the languages.

The neutral form is C restricted to what C, C++, GLSL, HLSL and WGSL share: no ternary, no assignment to a parameter,
braces everywhere, loops by `while`, locals declared as `float x = ...;` or `int i = ...;`, literals with f,
`exp log sqrt abs sin cos tan ceil floor`, `one(x > y)` for 1 if true and else 0, and `$name` for names of the file.
"""

import dataclasses
import re
from collections.abc import Mapping, Sequence

import numpy as np

from .._words import shown
from .languages import Language, spelt_names

NO_WARP = 3.4e38  # for lambda = inf: shading languages leave infinities undefined
LARGEST = float(np.finfo(np.float32).max)  # what is above it is infinite
ETA_NOTE = "eta in (0, 1] of the angle theta (radians) between light and view; 1: no warp."
LAMBDA_NOTE = "lambda, the warp's near-plane distance, in units of z_near; 3.4e38: no warp."


@dataclasses.dataclass(frozen=True)
class Function:
    """A function of floats, which returns a float or fills arrays.

    Attributes:
        name: without the prefix.
        note: one line of documentation.
        parameters: names, all float.
        body: neutral form.
        arrays: of floats that it fills, after the parameters: name and length. With any it returns nothing.
    """

    name: str
    note: str
    parameters: tuple[str, ...]
    body: str
    arrays: Mapping[str, int] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Program:
    """The content of a file.

    Attributes:
        notes: comment lines at its head.
        constants: int or float; arrays: of floats; names without the prefix, in capitals.
        functions: each may call those before it.
    """

    notes: Sequence[str]
    constants: Mapping[str, int | float]
    arrays: Mapping[str, np.ndarray]
    functions: Sequence[Function]


# In every file, after the specific notes.
HOW_TO = (
    "",
    "To warp: d in [0, mu] is the depth along the view made perpendicular to the light, x lies across it.",
    "With delta = d/mu and A = (1 - delta) eta + delta the shadow map has s = delta/A and t = 1/2 + x/(2 xmax A),",
    "xmax the largest |x|/A of the frustum's corners. As a matrix: w = A, row s = delta, row t = x/(2 xmax) + A/2,",
    "depth row a h + b A with h the depth along the light, a > 0 and b such that (a h + b A)/A fills your depth range.",
    "Or: a perspective frustum along d, apex lambda = mu eta/(1 - eta) before the body, from lambda to lambda + mu.",
    "",
)


def checked_prefix(prefix: str) -> str:
    """The prefix, if it is valid at the start of names in every language.

    Raises:
        ValueError: a prefix that does not begin with a lower-case letter, or has characters other than lower-case
            letters, digits and single underscores between them (GLSL reserves double ones).

    Example:
        >>> checked_prefix("sun_p")
        'sun_p'
    """
    word = isinstance(prefix, str) and re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", prefix)
    if not word or prefix.startswith("gl_"):
        raise ValueError(
            f"prefix: got {shown(prefix)}, expected lower-case letters, digits and single underscores, such as 'sun_p'"
        )
    return prefix


def text_of(program: Program, language: Language, prefix: str = "warpopt") -> str:
    """The whole file; equal programs give identical bytes.

    Args:
        prefix: prefix of all names in the file, in capitals for constants and the include guard.

    Raises:
        ValueError: an invalid prefix (see `checked_prefix`).

    Example:
        >>> from warpopt.export.languages import WGSL
        >>> double = Function("double", "2 x.", ("x",), "return 2.0f * x;")
        >>> print(text_of(Program(["Made."], {}, {}, [double]), WGSL).split("Made.")[1].strip())
        // 2 x.
        fn warpopt_double(x: f32) -> f32 {
            return 2.0 * x;
        }
    """
    capitals = checked_prefix(prefix).upper()
    comment = "\n".join(f"// {line}".rstrip() for line in program.notes)
    constants = []
    for name, value in program.constants.items():
        kind = "int" if isinstance(value, int) else "float"
        text = str(value) if kind == "int" else single(value) + language.literal
        constants.append(language.constant(f"{capitals}_{name}", kind, text))
    arrays = [
        language.array(f"{capitals}_{name}", [single(v) + language.literal for v in values])
        for name, values in program.arrays.items()
    ]
    functions = [_function(function, language, prefix) for function in program.functions]
    parts = [comment, language.before(capitals), *constants, "", *arrays, *functions]
    return "\n".join(parts).rstrip("\n") + "\n" + language.after(capitals)


def _function(function: Function, language: Language, prefix: str) -> str:
    name = f"{prefix}_{function.name}"
    if function.arrays:
        head = language.filler(name, function.parameters, function.arrays)
    else:
        unused = [name for name in function.parameters if not re.search(rf"\b{name}\b", function.body)]
        head = language.function(name, function.parameters, unused)
    body = language.body(function.body, prefix, function.arrays)
    return f"// {spelt_names(function.note, prefix)}\n{head}{body}}}\n"


def single(value: float) -> str:
    """The shortest text that reads back as this float32 number, with a decimal point.

    Example:
        >>> single(0.1), single(1.0), single(1e-30)
        ('0.1', '1.0', '1e-30')
    """
    if not abs(value) <= float(np.finfo(np.float32).max):
        raise ValueError(f"value: got {value!r}, expected a number in the range of float32")
    text = str(np.float32(value))
    return text if "." in text or "e" in text else text + ".0"
