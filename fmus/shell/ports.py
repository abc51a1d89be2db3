"""Port declarations: the one variable table of an FMU.

A component declares its ports as classes whose fields are made with `port`:

    @ports
    class Parameters:
        observer_gain: Vector = port("1/s", "diagonal of L in (17)", start=(5, 8, 8, 5), minimum=0)

The same declarations generate the C++ header, both model descriptions, the port table of the README and, for a
diagnoser, the symbols its step is written in. An instance of such a class holds one value per port, in the order of
declaration; `flatten` and `unflatten` convert between an instance and one long vector.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, TypeVar, dataclass_transform

T = TypeVar("T")

#: Value of a port inside a symbolic step: a CasADi SX column vector (a 1x1 SX for a scalar port).
Vector = Any
Scalar = Any

_PORT = "rotordx.port"


@dataclasses.dataclass(frozen=True)
class Port:
    """One port: a scalar (`shape` is None) or an array of `shape` elements, all float64, SI units."""

    name: str
    unit: str
    description: str
    start: tuple[float, ...]
    shape: int | None
    minimum: float | None = None
    maximum: float | None = None
    #: names of the values 0, 1, 2, ... of an enumeration parameter
    choices: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """Number of float64 elements."""
        return len(self.start)

    def element_names(self) -> list[str]:
        """Names of the elements as FMI 2 scalars: `name`, or `name[1]`, `name[2]`, ..."""
        return [self.name] if self.shape is None else [f"{self.name}[{i + 1}]" for i in range(self.shape)]


def port(
    unit: str,
    description: str,
    start: float | Sequence[float] = 0.0,
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    choices: Sequence[str] = (),
) -> Any:
    """Declare a port in a class decorated with `ports`.

    Args:
        unit: SI unit such as "m/s", "rad/s2", "N.m" or "1" for a pure number.
        description: one line for model descriptions and port tables.
        start: start value; a sequence makes an array port of its length, a number a scalar port.
        minimum: smallest allowed value of every element, None if there is none.
        maximum: largest allowed value of every element, None if there is none.
        choices: names of the values 0, 1, 2, ... if the port is an enumeration.
    """
    shape = len(start) if isinstance(start, Sequence) else None
    values = tuple(float(v) for v in start) if isinstance(start, Sequence) else (float(start),)
    declaration = Port("", unit, description, values, shape, minimum, maximum, tuple(choices))
    return dataclasses.field(metadata={_PORT: declaration})


@dataclass_transform(frozen_default=True, field_specifiers=(port,))
def ports(cls: type[T]) -> type[T]:
    """Class decorator: a frozen dataclass whose fields are ports; subclasses append to the ports they inherit."""
    return dataclasses.dataclass(frozen=True)(cls)


def table(cls: type[Any]) -> tuple[Port, ...]:
    """Ports of a class decorated with `ports`, in the order of declaration."""
    return tuple(dataclasses.replace(field.metadata[_PORT], name=field.name) for field in dataclasses.fields(cls))


def size(cls: type[Any]) -> int:
    """Number of float64 elements of all ports of a class."""
    return sum(p.size for p in table(cls))


def start_values(cls: type[Any]) -> list[float]:
    """Start values of all ports of a class as one flat list."""
    return [value for p in table(cls) for value in p.start]


def with_starts(cls: type[Any], starts: Mapping[str, float | Sequence[float]]) -> type[Any]:
    """The same ports with other start values; names that are not ports of the class are passed over."""
    fields = []
    for p in table(cls):
        start = starts.get(p.name, p.start)
        values = tuple(map(float, start)) if isinstance(start, Sequence) else (float(start),)
        fields.append((p.name, Any, dataclasses.field(metadata={_PORT: dataclasses.replace(p, start=values)})))
    return dataclasses.make_dataclass(cls.__name__, fields, frozen=True)


def flatten(instance: Any, concatenate: Callable[..., Any]) -> Any:
    """All port values of an instance as one vector; `concatenate` is casadi.vertcat or a numpy equivalent."""
    values = []
    for p in table(type(instance)):
        value = getattr(instance, p.name)
        length = getattr(value, "numel", lambda: None)()
        if length is not None and length != p.size:
            raise ValueError(f"{type(instance).__name__}.{p.name} has {length} elements, its port declares {p.size}")
        values.append(value)
    return concatenate(*values)


def unflatten(cls: type[T], vector: Any) -> T:
    """Instance of a port class from one flat vector (anything that can be sliced)."""
    values, offset = {}, 0
    for p in table(cls):
        values[p.name] = vector[offset] if p.shape is None else vector[offset : offset + p.size]
        offset += p.size
    return cls(**values)


STEP_SIZE = Port(
    "step_size", "s", "internal step; a communication step must be a multiple of it", (0.002,), None, 1e-6, 1.0
)


@dataclasses.dataclass(frozen=True)
class Component:
    """An FMU as the shell sees it; the declarations are checked when it is made.

    `parameters` are port classes in the order in which they lie in memory, after `step_size`. Outputs change only in
    a step; their values at initialisation follow from the parameters, and also from the inputs if
    `initial_outputs_from_inputs` (a sensor shows what it is connected to), or are the declared start values if
    `constant_initial_outputs`. With `tunable_parameters` every parameter but `step_size` may change between steps and
    acts from the next step on; otherwise parameters are fixed once the FMU is initialised. `step_size` is where the
    parameter of that name starts [s].

    Raises:
        ValueError: if a declaration is inconsistent; the message names the component and the port.
    """

    name: str
    description: str
    inputs: type[Any]
    outputs: type[Any]
    parameters: tuple[type[Any], ...] = ()
    initial_outputs_from_inputs: bool = False
    constant_initial_outputs: bool = False
    tunable_parameters: bool = False
    step_size: float = STEP_SIZE.start[0]

    def __post_init__(self) -> None:
        names = set()
        for _, causality, group in self.groups():
            for p in group:
                problem = _problem(p, causality)
                if p.name in names:
                    problem = "is declared twice"
                if problem:
                    raise ValueError(f"component {self.name}: port {p.name} {problem}")
                names.add(p.name)

    def groups(self) -> Iterator[tuple[str, str, tuple[Port, ...]]]:
        """(group name, causality, ports) in memory order: inputs, step size, parameter classes, outputs."""
        yield "inputs", "input", table(self.inputs)
        yield "step_size", "parameter", (dataclasses.replace(STEP_SIZE, start=(self.step_size,)),)
        for cls in self.parameters:
            yield cls.__name__, "parameter", table(cls)
        yield "outputs", "output", table(self.outputs)

    def variables(self) -> Iterator[tuple[int, str, Port]]:
        """(value reference = offset of the first element, causality, port) in memory order."""
        offset = 0
        for _, causality, group in self.groups():
            for p in group:
                yield offset, causality, p
                offset += p.size


def started(component: Component, starts: Mapping[str, float]) -> Component:
    """The component with parameters that start elsewhere.

    Args:
        component: declarations.
        starts: start values by the names of elements ("mass", "gain[2]"); names of no parameter are passed over.

    Raises:
        ValueError: a start value is not possible.
    """
    parameters = tuple(
        with_starts(
            cls,
            {p.name: [starts.get(n, s) for n, s in zip(p.element_names(), p.start, strict=True)] for p in table(cls)},
        )
        for cls in component.parameters
    )
    step_size = starts.get(STEP_SIZE.name, component.step_size)
    return dataclasses.replace(component, parameters=parameters, step_size=step_size)


def _problem(p: Port, causality: str) -> str | None:
    """What is wrong with a declaration, None if nothing is."""
    if p.name == "time":
        return "has the name of FMI's independent variable"
    if p.choices and (causality != "parameter" or p.shape is not None):
        return "has choices, which only a scalar parameter may have"
    if causality == "output":
        return None
    for value in p.start:
        if not math.isfinite(value):
            return f"starts at {value}, which is not finite"
        if (
            not (-math.inf if p.minimum is None else p.minimum)
            <= value
            <= (math.inf if p.maximum is None else p.maximum)
        ):
            return f"starts at {value}, outside its range"
        if p.choices and value not in range(len(p.choices)):
            return f"starts at {value}, which is none of its {len(p.choices)} choices"
    return None
