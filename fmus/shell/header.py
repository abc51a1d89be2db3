"""C++ from a component's ports: the struct that the model reads and writes, and the table that the shell reads."""

from __future__ import annotations

import re

from rotordx.fmus.shell.ports import Component, Port, size, table

_GENERATED = "// Generated from the port declarations of {name}; changes belong there.\n"


def ports_header(component: Component, accessors: bool) -> str:
    """`<name>_ports.hpp`: the struct `Ports` of values in memory order.

    With `accessors` every port is a member function: arrays are Eigen maps, scalars references, enumerations ints.
    Generated diagnosers address the blocks of `Ports` and do without.
    """
    count = sum(p.size for _, _, p in component.variables())
    input_count = size(component.inputs)
    lines = [
        _GENERATED.format(name=component.name) + "#pragma once\n",
        "#include <Eigen/Core>\n" if accessors else "",
        "namespace rotordx {\n",
        f"/// {component.description}.",
        "struct Ports {",
        f"  static constexpr int kCount = {count};",
        f"  static constexpr int kStepSize = {input_count};  ///< first of the parameters",
        f"  static constexpr int kOutputs = {count - size(component.outputs)};",
        "  double value[kCount];",
    ]
    if accessors:
        lines += [line for variable in component.variables() for line in _accessors(*variable)]
        lines += _parameter_blocks(component)
    return "\n".join([*lines, "};\n", "}  // namespace rotordx\n"])


def component_source(component: Component, token: str, model: str, includes: list[str]) -> str:
    """`<name>_component.cpp`: the definition of `rotordx::component` (see component.hpp) for one FMU.

    Args:
        component: declarations of the FMU.
        token: GUID or instantiation token of both model descriptions.
        model: C++ type of the model.
        includes: headers that declare it.
    """
    variables = list(component.variables())
    index = [str(i) for i, (_, _, p) in enumerate(variables) for _ in range(p.size)]
    start = [_literal(value) for _, _, p in variables for value in p.start]
    return "\n".join(
        [
            _GENERATED.format(name=component.name),
            "#include <cmath>\n",
            *[f'#include "{include}"' for include in includes],
            '#include "fmus/shell/model_adapter.hpp"\n',
            "namespace rotordx {\nnamespace {\n",
            "constexpr Variable kVariables[] = {",
            *[_row(offset, p) for offset, _, p in variables],
            "};\n",
            f"constexpr std::uint16_t kVariableOf[] = {{{', '.join(index)}}};\n",
            f"constexpr double kStart[] = {{{', '.join(start)}}};\n",
            "}  // namespace\n",
            f"extern const Component component = describe<{model}>(",
            f'    "{component.name}", "{token}", kVariables, kVariableOf, kStart, '
            f"{_flag(component.tunable_parameters)});\n",
            "}  // namespace rotordx\n",
        ]
    )


def _accessors(offset: int, _: str, p: Port) -> list[str]:
    comment = f"  /// {p.unit}: {p.description}"
    at = f"value + {offset}" if offset else "value"
    if p.choices:
        items = ", ".join(f"k{_camel(choice)}" for choice in p.choices)
        return [
            f"  enum class {_camel(p.name)} {{ {items} }};",
            comment,
            f"  int {p.name}() const {{ return static_cast<int>(value[{offset}]); }}",
        ]
    if p.shape is None:
        return [
            comment,
            f"  double& {p.name}() {{ return value[{offset}]; }}",
            f"  double {p.name}() const {{ return value[{offset}]; }}",
        ]
    vector = f"Eigen::Matrix<double, {p.size}, 1>"
    return [
        comment,
        f"  Eigen::Map<{vector}> {p.name}() {{ return Eigen::Map<{vector}>({at}); }}",
        f"  Eigen::Map<const {vector}> {p.name}() const {{ return Eigen::Map<const {vector}>({at}); }}",
    ]


def _parameter_blocks(component: Component) -> list[str]:
    """One pointer per parameter class to its contiguous values, for functions generated from the same class."""
    lines, offset = [], size(component.inputs) + 1
    for cls in component.parameters:
        name = re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()
        lines.append(f"  /// {size(cls)} values in the order of {cls.__name__}")
        lines.append(f"  const double* {name}() const {{ return value + {offset}; }}")
        offset += sum(p.size for p in table(cls))
    return lines


def _row(offset: int, p: Port) -> str:
    """A port as the shell's table has it; an enumeration ranges over its choices."""
    low, high = (0.0, len(p.choices) - 1.0) if p.choices else (p.minimum, p.maximum)
    shape = f"{_flag(p.shape is not None)}, {_flag(bool(p.choices))}"
    bounds = f"{_bound(low, '-INFINITY')}, {_bound(high, 'INFINITY')}"
    return f'    {{"{p.name}", {offset}, {p.size}, {shape}, {bounds}}},'


def _camel(name: str) -> str:
    return "".join(word.capitalize() for word in name.split("_"))


def _flag(value: bool) -> str:
    return "true" if value else "false"


def _bound(value: float | None, unbounded: str) -> str:
    return unbounded if value is None else _literal(value)


def _literal(value: float) -> str:
    return "NAN" if value != value else repr(float(value))
