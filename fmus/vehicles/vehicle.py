"""Reading vehicle files: sections of FMU parameters in TOML, inherited from a base and checked against the ports."""

from __future__ import annotations

import dataclasses
import difflib
import json
import math
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

from rotordx.fmus import component_names, load_component, vehicle_names
from rotordx.fmus.shell import ports

T = TypeVar("T")
Value = float | tuple[float, ...]

#: Minimum of a port whose value must be positive: the bounds of a port belong to its range.
POSITIVE = 1e-12


class VehicleError(ValueError):
    """A vehicle or a design cannot be used; the message names file, key and remedy."""


@dataclasses.dataclass(frozen=True)
class Vehicle:
    """One vehicle: FMU parameters by port name, SI units; arrays are tuples.

    `files` are the files it was read from: its own one first, then those of its bases.
    """

    name: str
    description: str
    parameters: dict[str, Value]
    files: tuple[Path, ...] = ()

    def fill(self, cls: type[T]) -> T:
        """Instance of a port class with this vehicle's values, where it has none with the ports' start values.

        Scalars are floats, arrays are numpy arrays.
        """
        import numpy as np  # here, because commands that only name vehicles start quicker without it

        values = {}
        for p in ports.table(cls):
            value = self.parameters.get(p.name, p.start if p.shape else p.start[0])
            values[p.name] = np.array(value) if p.shape else value
        return cls(**values)


def packaged(name: str) -> Path:
    """File of a packaged vehicle."""
    return Path(str(resources.files("rotordx.fmus.vehicles") / f"{name}.toml"))


def load_vehicle(name_or_path: str | Path) -> Vehicle:
    """Read and check a vehicle.

    Args:
        name_or_path: name of a packaged vehicle, or path of a vehicle file (ends in `.toml`).

    Raises:
        VehicleError: if the file cannot be read, or a parameter is unknown, missing, of the wrong length, not finite,
            out of its port's range or at odds with the others.
    """
    return _load(_locate(str(name_or_path), Path()), ())


def load_design(vehicle: Vehicle | str, diagnoser: str) -> dict[str, Any] | None:
    """Designed parameters of a diagnoser for a vehicle, None if there are none.

    They lie in `designs/<vehicle>/<diagnoser>.json` beside the vehicle's file; a vehicle without a design of its own
    uses that of its base.

    Args:
        vehicle: a loaded vehicle, or the name of a packaged one.
        diagnoser: id of the diagnoser.

    Raises:
        VehicleError: if there is a design but it cannot be read.
    """
    for file in vehicle.files if isinstance(vehicle, Vehicle) else (packaged(vehicle),):
        path = file.parent / "designs" / file.stem / f"{diagnoser}.json"
        if path.is_file():
            try:
                design = json.loads(path.read_text(encoding="utf-8"))
            except (OSError, ValueError) as error:
                raise VehicleError(f"{path}: cannot be read as JSON ({error}); design it anew") from error
            if not isinstance(design, dict) or not isinstance(design.get("parameters"), dict):
                raise VehicleError(f"{path}: has no `parameters`; design it anew")
            return design
    return None


@dataclasses.dataclass(frozen=True)
class VehicleFile:
    """What one vehicle file says, unchecked against the ports: `base` is the vehicle it modifies, if any."""

    description: str | None
    base: str | None
    parameters: dict[str, Value]


def read_file(path: Path) -> VehicleFile:
    """Read a vehicle file: the keys of all sections in one dictionary.

    Raises:
        VehicleError: if the file cannot be read, or a key is given twice or is not a number or a list of numbers.
    """
    try:
        document = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise VehicleError(f"{path}: cannot be read: {error.strerror}; give the path of a vehicle file") from error
    except ValueError as error:  # of the encoding or of the TOML
        raise VehicleError(f"{path}: is not valid TOML: {error}; correct the file") from error
    texts = {}
    for key in ("description", "base"):
        texts[key] = document.pop(key, None)
        if not isinstance(texts[key], str | None):
            raise VehicleError(f"{path}: `{key}` must be a text; put it in quotes")
    parameters: dict[str, Value] = {}
    for section, content in document.items():
        if not isinstance(content, dict):
            raise VehicleError(f"{path}: `{section}` is outside a section; put it below a heading such as [body]")
        for key, value in content.items():
            if key in parameters:
                raise VehicleError(f"{path}: `{key}` is given in two sections; delete one of them")
            parameters[key] = _number_or_numbers(path, key, value)
    return VehicleFile(texts["description"], texts["base"], parameters)


def _number_or_numbers(path: Path, key: str, value: Any) -> Value:
    elements = value if isinstance(value, list) else [value]
    if not all(isinstance(e, int | float) and not isinstance(e, bool) for e in elements):
        raise VehicleError(f"{path}: `{key}` must be a number or a list of numbers, not {value!r}")
    return tuple(float(e) for e in elements) if isinstance(value, list) else float(value)


def _locate(name_or_path: str, folder: Path) -> Path:
    """Path of a vehicle given by its packaged name, or by a path relative to a folder."""
    if name_or_path.endswith(".toml"):
        return folder / name_or_path
    if name_or_path in vehicle_names():
        return packaged(name_or_path)
    raise VehicleError(
        f"there is no packaged vehicle `{name_or_path}`{_nearest(name_or_path, vehicle_names())}; choose one of "
        f"{', '.join(vehicle_names())} or give the path of a vehicle file (.toml)"
    )


def _load(path: Path, readers: tuple[Path, ...]) -> Vehicle:
    if path.resolve() in readers:
        raise VehicleError(f"{path}: `base` leads back to this file; name a vehicle that does not build on it")
    own = read_file(path)
    known = _known_ports()
    for key, value in own.parameters.items():
        if key not in known:
            raise VehicleError(
                f"{path}: `{key}` is not a parameter of any FMU{_nearest(key, known)}; correct or delete it"
            )
        _check_value(path, known[key], value)
    if own.base is None:
        vehicle = Vehicle(path.stem, own.description or path.stem, own.parameters, (path,))
    else:
        base = _load(_locate(own.base, path.parent), (*readers, path.resolve()))
        vehicle = Vehicle(
            path.stem, own.description or base.description, base.parameters | own.parameters, (path, *base.files)
        )
    _check_vehicle(path, vehicle)
    return vehicle


def _known_ports() -> dict[str, ports.Port]:
    """Parameter ports of all packaged FMUs but the diagnosers, whose gains are designs, not vehicle parameters."""
    from rotordx.fmus.vehicles.parameters import SensorParameters, VehicleParameters  # they read lab_x through here

    classes: list[type[Any]] = [VehicleParameters, SensorParameters]
    for name in component_names():
        classes.extend(load_component(name).parameters)
    return {p.name: p for cls in classes for p in ports.table(cls)}


def _nearest(name: str, names: Any) -> str:
    matches = difflib.get_close_matches(name, list(names), n=1)
    return f" (did you mean `{matches[0]}`?)" if matches else ""


def _check_value(path: Path, port: ports.Port, value: Value) -> None:
    """Length and range of one parameter, against its port."""
    elements = value if isinstance(value, tuple) else (value,)
    if (port.shape is None) != isinstance(value, float) or len(elements) != port.size:
        wanted = "one number" if port.shape is None else f"a list of {port.shape} numbers"
        given = "one number" if isinstance(value, float) else f"a list of {len(elements)}"
        raise VehicleError(f"{path}: `{port.name}` is {given}; give {wanted} ({port.unit}: {port.description})")
    for element, name in zip(elements, port.element_names(), strict=True):
        if not math.isfinite(element):
            raise VehicleError(f"{path}: `{name}` is {element}; give a finite number ({port.unit})")
        if port.minimum is not None and element < port.minimum:
            limit = "positive" if port.minimum == POSITIVE else f"at least {port.minimum:g}"
            raise VehicleError(f"{path}: `{name}` is {element:g} but must be {limit} ({port.unit}: {port.description})")
        if port.maximum is not None and element > port.maximum:
            limit = f"at most {port.maximum:g}"
            raise VehicleError(f"{path}: `{name}` is {element:g} but must be {limit} ({port.unit}: {port.description})")


def _check_vehicle(path: Path, vehicle: Vehicle) -> None:
    """Completeness, and what parameters must fulfil together."""
    from rotordx.fmus.vehicles.parameters import VehicleParameters

    missing = [p for p in ports.table(VehicleParameters) if p.name not in vehicle.parameters]
    if missing:
        p = missing[0]
        raise VehicleError(f"{path}: `{p.name}` is missing; add it ({p.unit}: {p.description}) or name a `base`")
    values = vehicle.fill(VehicleParameters)
    if any(abs(direction) != 1 for direction in values.rotor_direction):
        raise VehicleError(f"{path}: `rotor_direction` must consist of 1 (counter-clockwise) and -1 (clockwise)")
    if 2 * max(values.inertia) > sum(values.inertia):
        raise VehicleError(
            f"{path}: `inertia` belongs to no rigid body, one moment exceeds the sum of the two others; check its units"
        )
    if values.rotor_speed_min >= values.rotor_speed_max:
        raise VehicleError(f"{path}: `rotor_speed_min` must be below `rotor_speed_max`; correct one of them (rad/s)")
    _check_hover(path, values)


def _check_hover(path: Path, values: Any) -> None:
    """The rotors can hold the vehicle in hover: catches wrong geometry, signs and units of nearly every parameter."""
    import numpy as np

    from rotordx.fmus.model_terms.allocation import allocation_rows

    allocation = np.array(allocation_rows(values))
    if np.linalg.matrix_rank(allocation / np.abs(allocation).max(axis=1, keepdims=True)) < 4:
        raise VehicleError(
            f"{path}: the rotors cannot produce thrust and three torques independently of each other; "
            "check `rotor_x`, `rotor_y` and `rotor_direction`"
        )
    squared_speed = np.linalg.solve(allocation, [values.mass * values.gravity, 0, 0, 0])
    hover_speed = np.sign(squared_speed) * np.sqrt(np.abs(squared_speed))
    for rotor, speed in enumerate(hover_speed, start=1):
        if not values.rotor_speed_min <= speed <= values.rotor_speed_max:
            raise VehicleError(
                f"{path}: cannot hover: rotor {rotor} would have to turn at {speed:.4g} rad/s, which is not between "
                "`rotor_speed_min` and `rotor_speed_max`; check these, `mass`, `thrust_coefficient` and the geometry"
            )
