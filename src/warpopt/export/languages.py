"""The syntax of each language for the neutral form of `program`."""

import dataclasses
import re
from collections.abc import Callable, Iterable, Mapping


@dataclasses.dataclass(frozen=True)
class Language:
    """The differences between languages.

    Attributes:
        name, suffix: the language's name and its file suffix.
        before, after: map (prefix in capitals) to the text before and after the content.
        array: maps (name, number texts) to a constant array.
        constant: maps (name, "int" or "float", text) to a named constant.
        function: maps (name, parameters, unused parameters) to the text of a function before its body.
        filler: maps (name, parameters, {array: length}) to the text, before its body, of a function that fills arrays.
        literal: the suffix of a single-precision number.
        math: maps a mathematical function's name to its name in the language.
        declare: maps ("int" or "float", name) to a local variable's declaration.
        one: the start of the conversion of a truth value to 0 or 1.
        filled: maps the name of an array that is filled to what is indexed.
    """

    name: str
    suffix: str
    before: Callable[[str], str]
    after: Callable[[str], str]
    array: Callable[[str, list[str]], str]
    constant: Callable[[str, str, str], str]
    function: Callable[[str, tuple[str, ...], list[str]], str]
    filler: Callable[[str, tuple[str, ...], Mapping[str, int]], str]
    literal: str = ""
    math: Callable[[str], str] = lambda name: name
    declare: Callable[[str, str], str] = lambda kind, name: f"{kind} {name}"
    one: str = "int("
    filled: Callable[[str], str] = lambda name: name

    def body(self, text: str, prefix: str, arrays: Iterable[str] = ()) -> str:
        """A function's body from the neutral form, indented; `arrays`: those among its parameters."""
        text = spelt_names(text.strip("\n"), prefix)
        for name in arrays:
            text = re.sub(rf"\b{name}\[", lambda _, name=name: f"{self.filled(name)}[", text)
        text = re.sub(r"\b(exp|log|sqrt|abs|sin|cos|tan|ceil|floor)\(", lambda m: f"{self.math(m[1])}(", text)
        text = re.sub(r"\bone\(", self.one, text)
        text = re.sub(r"(\d)f\b", rf"\g<1>{self.literal}", text)
        text = re.sub(r"\b(float|int) (\w+)(?= =)", lambda m: self.declare(m[1], m[2]), text)
        return "".join(f"    {line}\n" for line in text.split("\n"))


def spelt_names(text: str, prefix: str) -> str:
    """$eta as prefix_eta, $KNOTS as PREFIX_KNOTS."""
    return re.sub(r"\$(\w+)", lambda m: f"{prefix.upper() if m[1].isupper() else prefix}_{m[1]}", text)


def _lines(values: list[str]) -> str:
    return ",\n    ".join(", ".join(values[i : i + 6]) for i in range(0, len(values), 6))


def _braces(lead: str) -> Callable[[str, list[str]], str]:
    return lambda name, values: f"{lead} {name}[{len(values)}] = {{\n    {_lines(values)}\n}};\n"


def _floats(parameters: tuple[str, ...]) -> str:
    return ", ".join(f"float {name}" for name in parameters)


def _plain_function(name: str, parameters: tuple[str, ...], unused: list[str]) -> str:
    return f"float {name}({_floats(parameters)}) {{\n"


def _plain_filler(name: str, parameters: tuple[str, ...], arrays: Mapping[str, int]) -> str:
    filled = "".join(f", out float {array}[{length}]" for array, length in arrays.items())
    return f"void {name}({_floats(parameters)}{filled}) {{\n"


def _c_filler(name: str, parameters: tuple[str, ...], arrays: Mapping[str, int]) -> str:
    filled = "".join(f", float {array}[{length}]" for array, length in arrays.items())
    return f"static inline void {name}({_floats(parameters)}{filled}) {{\n"


def _cpp_filler(name: str, parameters: tuple[str, ...], arrays: Mapping[str, int]) -> str:
    filled = "".join(f", float (&{array})[{length}]" for array, length in arrays.items())
    return f"inline void {name}({_floats(parameters)}{filled}) noexcept {{\n"


def _c_function(name: str, parameters: tuple[str, ...], unused: list[str]) -> str:
    # C99 has no attribute for unused parameters, and engines compile with -Wunused-parameter.
    used = "".join(f"    (void){parameter};\n" for parameter in unused)
    return f"static inline float {name}({_floats(parameters)}) {{\n{used}"


def _cpp_function(name: str, parameters: tuple[str, ...], unused: list[str]) -> str:
    words = ", ".join(f"{'[[maybe_unused]] ' * (p in unused)}float {p}" for p in parameters)
    return f"inline float {name}({words}) noexcept {{\n"


def _wgsl_function(name: str, parameters: tuple[str, ...], unused: list[str]) -> str:
    return f"fn {name}({', '.join(f'{p}: f32' for p in parameters)}) -> f32 {{\n"


def _wgsl_filler(name: str, parameters: tuple[str, ...], arrays: Mapping[str, int]) -> str:
    typed = [f"{p}: f32" for p in parameters]
    typed += [f"{array}: ptr<function, array<f32, {length}>>" for array, length in arrays.items()]
    return f"fn {name}({', '.join(typed)}) {{\n"


_WGSL_TYPE = {"float": "f32", "int": "i32"}

C = Language(
    "C99", ".h",
    lambda prefix: f"#ifndef {prefix}_H\n#define {prefix}_H\n\n#include <math.h>\n", lambda prefix: "\n#endif\n",
    _braces("static const float"), lambda name, kind, value: f"#define {name} {value}", _c_function, _c_filler, "f",
    lambda name: {"abs": "fabsf"}.get(name, f"{name}f"), one="(int)(",
)  # fmt: skip
CPP = Language(
    "C++17", ".hpp",
    lambda prefix: f"#ifndef {prefix}_HPP\n#define {prefix}_HPP\n\n#include <cmath>\n", lambda prefix: "\n#endif\n",
    _braces("inline constexpr float"),
    lambda name, kind, value: f"inline constexpr {kind} {name} = {value};", _cpp_function, _cpp_filler, "f",
    lambda name: f"std::{'fabs' if name == 'abs' else name}",
)  # fmt: skip


def _glsl(version: int) -> Language:
    return Language(
        f"GLSL {version}", f".{version}.glsl", lambda prefix: f"// For #version {version} and later.\n", lambda _: "",
        lambda name, values: f"const float {name}[{len(values)}] = float[](\n    {_lines(values)}\n);\n",
        lambda name, kind, value: f"const {kind} {name} = {value};", _plain_function, _plain_filler,
    )  # fmt: skip


GLSL_330, GLSL_450 = _glsl(330), _glsl(450)
HLSL = Language(
    "HLSL", ".hlsl", lambda _: "", lambda _: "", _braces("static const float"),
    lambda name, kind, value: f"static const {kind} {name} = {value};", _plain_function, _plain_filler,
)  # fmt: skip
WGSL = Language(
    "WGSL", ".wgsl", lambda _: "", lambda _: "",
    # Not `const`: compilers before 2024-09 cannot index a constant by a variable (gfx-rs/wgpu, pull request 6188).
    lambda name, values: f"var<private> {name} = array<f32, {len(values)}>(\n    {_lines(values)}\n);\n",
    lambda name, kind, value: f"const {name}: {_WGSL_TYPE[kind]} = {value};", _wgsl_function, _wgsl_filler,
    declare=lambda kind, name: f"var {name}: {_WGSL_TYPE[kind]}", one="i32(",
    filled=lambda name: f"(*{name})",
)  # fmt: skip

LANGUAGES = {"c": (C,), "cpp": (CPP,), "glsl": (GLSL_330, GLSL_450), "hlsl": (HLSL,), "wgsl": (WGSL,)}
