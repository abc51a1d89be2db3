"""CasADi's C as strict C99 in either precision: a compiler finds nothing to warn of, and nothing else is computed.

CasADi prints double literals and calls double functions whatever `casadi_real` is, and answers queries about its
functions that nobody makes. Here its statements are kept, in their order, and what is around them is printed anew.
"""

from __future__ import annotations

import re

from casadi import CasadiMeta

_PREAMBLE = """\
/* {file}: the diagnoser's symbolic step as printed by CasADi {version}; do not edit.
 * Compile with -ffp-contract=off and without -ffast-math: a time that is NaN means "not yet". */
#include <math.h>

#ifndef CASADI_SYMBOL_EXPORT
#define CASADI_SYMBOL_EXPORT
#endif

#ifndef casadi_real
#ifdef ROTORDX_SINGLE
#define casadi_real float
#else
#define casadi_real double
#endif
#endif

#ifdef ROTORDX_SINGLE
#define CASADI_MATH(function) function##f
#else
#define CASADI_MATH(function) function
#endif
"""

#: what CasADi defines beside its functions, if they call it
_HELPERS = {
    "casadi_sq": "static casadi_real casadi_sq(casadi_real x) { return x * x; }\n",
    "casadi_sign": "static casadi_real casadi_sign(casadi_real x) { return x < 0 ? -1 : x > 0 ? 1 : x; }\n",
}
_LIBM = re.compile(
    "exp|log|sqrt|sin|cos|tan|asin|acos|atan|atan2|sinh|cosh|tanh|asinh|acosh|atanh|expm1|log1p|"
    "floor|ceil|fmod|remainder|fabs|fmin|fmax|copysign|hypot|erf|pow"
)
_SIGNATURE = "int {name}(const casadi_real** arg, casadi_real** res, int* iw, casadi_real* w, int mem)"

_FUNCTION = re.compile(
    r"^static int casadi_f\d+\(const casadi_real\*\* arg[^{]*\{\n(.*?)^\}\n\nCASADI_SYMBOL_EXPORT int (\w+)\(",
    re.MULTILINE | re.DOTALL,
)
_CALL = re.compile(r"\b(?:casadi_)?([a-z]\w*)\(")
_LITERAL = re.compile(r"(?<![\w.])\d+\.\d*(?:e[+-]?\d+)?")
_PLAIN = (
    (re.compile(r"if \(res\[\d+\]!=0\) "), ""),
    (re.compile(r"arg\[(\d+)\]\? (arg\[\1\]\[\d+\]) : 0"), r"\2"),
    (re.compile(r"\bcasadi_nan\b"), "(casadi_real)NAN"),
    (re.compile(r"\bcasadi_inf\b"), "(casadi_real)INFINITY"),
    # a number is no truth value: the same comparison with 0, said aloud
    (re.compile(r"=\((a\d+)\?"), r"=(\1!=0?"),
    (re.compile(r"=\(!(a\d+)\)"), r"=(\1==0)"),
    (re.compile(r"=\((a\d+)(&&|\|\|)(a\d+)\)"), r"=(\1!=0\2\3!=0)"),
)


def strict_source(file: str, text: str) -> str:
    """C99 of a file that CasADi generated: its functions alone, each with CasADi's signature.

    Literals are rounded to `casadi_real`, functions are those of its precision: float with -DROTORDX_SINGLE. The first
    result may be the array of the first argument: a state advances in place.

    Raises:
        ValueError: if a statement calls a function that is not known here.
    """
    functions = {name: _body(file, body) for body, name in _FUNCTION.findall(text)}
    helpers = [helper for name, helper in _HELPERS.items() if any(f"{name}(" in body for body in functions.values())]
    parts = [_PREAMBLE.format(file=file, version=CasadiMeta.version()), *helpers]
    for name, body in functions.items():
        unused = "".join(f"  (void){p};\n" for p in ("arg", "iw", "w", "mem") if not re.search(rf"\b{p}\b", body))
        parts.append(f"CASADI_SYMBOL_EXPORT {_SIGNATURE.format(name=name)} {{\n{unused}{body}}}\n")
    return "\n".join(parts)


def strict_header(*names: str) -> str:
    """Prototypes of such functions."""
    prototypes = "".join(f"{_SIGNATURE.format(name=name)};\n" for name in names)
    real = "#ifndef casadi_real\n#define casadi_real double\n#endif\n"
    opening, closing = '#ifdef __cplusplus\nextern "C" {\n#endif\n', "#ifdef __cplusplus\n}\n#endif\n"
    return "\n".join(["#pragma once\n", real, opening, prototypes, closing])


def _body(file: str, body: str) -> str:
    """Statements of a function, with nothing in them that depends on the precision or is never needed."""
    for pattern, replacement in _PLAIN:
        body = pattern.sub(replacement, body)

    def call(match: re.Match[str]) -> str:
        if match[0][:-1] in _HELPERS:
            return match[0]
        if _LIBM.fullmatch(match[1]):
            return f"CASADI_MATH({match[1]})("
        raise ValueError(f"{file}: {match[0][:-1]} is no function of C99; write the step without it")

    return _in_place(_LITERAL.sub(r"(casadi_real)\g<0>", _CALL.sub(call, body)))


def _in_place(body: str) -> str:
    """The same statements; an element of `arg[0]` that is read after its place in `res[0]` was written is kept."""
    lines = body.splitlines(keepends=True)
    read = {match[1]: k for k, line in enumerate(lines) if (match := re.search(r"=arg\[0\]\[(\d+)\];", line))}
    for k, line in enumerate(lines):
        written = re.match(r"  res\[0\]\[(\d+)\]=", line)
        if written and (later := read.get(written[1], -1)) > k:
            lines[k] = f"  const casadi_real x{written[1]}=arg[0][{written[1]}];\n{line}"
            lines[later] = lines[later].replace(f"arg[0][{written[1]}]", f"x{written[1]}")
    return "".join(lines)
