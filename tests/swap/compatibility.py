"""Every FMU in both versions in every importer that pip installs: `make compatibility` writes the table.

Each cell runs in a process of its own: 500 steps with constant inputs, set in the initialisation; the final outputs are
compared with those that FMPy finds.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

import fmpy
from fmpy.fmi1 import FMICallException

from rotordx.fmus import component_names, diagnoser_ids, fmu_path

TABLE = Path(__file__).parents[2] / "orchestrator" / "compatibility.md"
STEP, STEPS = 0.002, 500
TOLERANCE = 1e-12
TIMEOUT_S = 120
PROCESSES = 2

HEADER = """# Compatibility

Written by `make compatibility` (tests/swap/compatibility.py): each FMU in both versions of FMI, 500 steps of 2 ms with
constant inputs, in every importer that pip installs. A number is the largest difference of a final output from the
value that FMPy {fmpy} finds, relative to the larger of 1 and that value; it must be at most 1e-12.

{rows}
{causes}"""


def values_of(description: fmpy.model_description.ModelDescription) -> dict[str, list[float]]:
    """Constant inputs by variable: rotors that turn, everything else small; one value for each element."""
    inputs, count = {}, 0
    for v in [v for v in description.modelVariables if v.causality == "input"]:
        size = int(v.dimensions[0].start) if v.dimensions else 1
        inputs[v.name] = [
            550.0 + 7 * (count + i) if "rotor_speed" in v.name else 0.01 * (count + i) for i in range(size)
        ]
        count += size
    return inputs


def in_fmpy(path: Path, inputs: Mapping[str, list[float]], outputs: Mapping[str, int]) -> list[float]:
    """FMPy's own classes, called in the order of the standard."""
    description = fmpy.read_model_description(str(path))
    references = {v.name: v.valueReference for v in description.modelVariables}
    two = description.fmiVersion.startswith("2")
    kind = fmpy.fmi2.FMU2Slave if two else fmpy.fmi3.FMU3Slave
    with tempfile.TemporaryDirectory() as folder:
        fmu = kind(
            guid=description.guid,
            unzipDirectory=fmpy.extract(str(path), folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="fmu",
        )
        fmu.instantiate()
        if two:
            fmu.setupExperiment(startTime=0.0)
        fmu.enterInitializationMode()
        for name, values in inputs.items():
            (fmu.setReal if two else fmu.setFloat64)([references[name]], values)
        fmu.exitInitializationMode()
        for k in range(STEPS):
            fmu.doStep(k * STEP, STEP)
        result = [
            value
            for name, size in outputs.items()
            for value in (fmu.getReal([references[name]]) if two else fmu.getFloat64([references[name]], size))
        ]
        fmu.terminate()
        fmu.freeInstance()
    return result


def in_ecos(path: Path, inputs: Mapping[str, list[float]], outputs: Mapping[str, int]) -> list[float]:
    """Ecos, from Python by ecospy."""
    import ecospy

    initial = {f"fmu::{name}": values[0] for name, values in inputs.items()}
    with ecospy.EcosSimulationStructure() as structure:
        structure.add_model("fmu", str(path))
        if initial:
            structure.add_parameter_set("inputs", initial)
        with ecospy.EcosSimulation(step_size=STEP, structure=structure) as simulation:
            simulation.init(parameter_set="inputs" if initial else None)
            simulation.step(STEPS)
            return [simulation.get_real(f"fmu::{name}") for name in outputs]


def in_libcosim(path: Path, inputs: Mapping[str, list[float]], outputs: Mapping[str, int]) -> list[float]:
    """libcosim, from Python by libcosimpy."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    execution = CosimExecution.from_step_size(round(1e9 * STEP))
    slave = CosimLocalSlave(fmu_path=str(path), instance_name="fmu")
    if not slave.ptr():
        from libcosimpy._internal import get_last_error_message

        raise RuntimeError(get_last_error_message())
    index = execution.add_local_slave(slave)
    references = {v.name.decode(): v.reference for v in execution.slave_variables(index)}
    for name, values in inputs.items():
        execution.real_initial_value(index, references[name], values[0])
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    execution.step(STEPS)
    found: list[float] = list(observer.last_real_values(index, [references[name] for name in outputs]))
    return found


def in_container(path: Path, inputs: Mapping[str, list[float]], outputs: Mapping[str, int]) -> list[float]:
    """A container FMU of fmu-manipulation-toolbox with this FMU in it, run by FMPy."""
    from fmu_manipulation_toolbox.assembly import Assembly

    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / path.name).write_bytes(path.read_bytes())
        layout = {
            "name": "container.fmu",
            "step_size": STEP,
            "auto_input": True,
            "auto_output": True,
            "fmu": [path.name],
        }
        (place / "container.json").write_text(json.dumps(layout))
        fmi = 2 if "fmi2" in path.parts else 3
        Assembly("container.json", fmu_directory=place).make_fmu(fmi_version=fmi)
        try:
            return in_fmpy(place / "container.fmu", inputs, outputs)
        except fmpy.model_description.ValidationError as error:
            problem = str(error).splitlines()[-1].lstrip("- ")
            raise RuntimeError(f"the modelDescription.xml that it writes is not valid: {problem}") from error


def in_pathsim(path: Path, inputs: Mapping[str, list[float]], outputs: Mapping[str, int]) -> list[float]:
    """The wrapper behind the blocks of pathsim-fmi."""
    from pathsim_fmi.wrapper import FMUWrapper

    wrapper = FMUWrapper(str(path), "fmu", mode="cosimulation")
    try:
        wrapper.initialize({name: values[0] for name, values in inputs.items()})
        for k in range(STEPS):
            wrapper.do_step(current_time=k * STEP, step_size=STEP)
        return [float(value) for value in wrapper.get_outputs_as_array()]
    except FMICallException as error:
        raise RuntimeError(
            f"it passes one value for each value reference, which FMI 3 arrays refuse: {error}"
        ) from error


def in_cofmupy(path: Path, inputs: Mapping[str, list[float]], outputs: Mapping[str, int]) -> list[float]:
    """CoFMUPy's coordinator."""
    [pinned] = [need for need in requires("cofmupy") or () if need.startswith("fmpy==")]
    if pinned != f"fmpy=={version('fmpy')}":
        raise RuntimeError(f"it needs {pinned}, which cannot be installed beside that of rotordx")

    from cofmupy.coordinator import Coordinator

    initial = {name: values if len(values) > 1 else values[0] for name, values in inputs.items()}
    coordinator = Coordinator()
    coordinator.start(
        {
            "fmus": [{"id": "fmu", "name": "fmu", "path": str(path), "initialization": initial}],
            "connections": [],
            "cosim_method": "jacobi",
            "iterative": False,
        }
    )
    for _ in range(STEPS):
        coordinator.do_step(STEP, save_data=True)
    results = coordinator.get_results()["fmu"]
    return [float(value) for name in outputs for value in _flat(results[name][-1])]


def _flat(value: object) -> list[float]:
    return [v for element in value for v in _flat(element)] if isinstance(value, list | tuple) else [float(str(value))]


Importer = Callable[[Path, Mapping[str, list[float]], Mapping[str, int]], list[float]]

#: title -> (distribution, function)
IMPORTERS: dict[str, tuple[str, Importer]] = {
    "FMPy": ("fmpy", in_fmpy),
    "Ecos": ("ecospy", in_ecos),
    "libcosim": ("libcosimpy", in_libcosim),
    "container": ("fmu-manipulation-toolbox", in_container),
    "pathsim": ("pathsim-fmi", in_pathsim),
    "CoFMUPy": ("cofmupy", in_cofmupy),
}


def final_values(importer: str, name: str, fmi: int) -> list[float]:
    """Final outputs of an FMU in an importer."""
    path = fmu_path(name, fmi)
    description = fmpy.read_model_description(str(path), validate=False)
    outputs = {
        v.name: int(v.dimensions[0].start) if v.dimensions else 1
        for v in description.modelVariables
        if v.causality == "output"
    }
    found = IMPORTERS[importer][1](path, values_of(description), outputs)
    if len(found) < sum(outputs.values()):
        raise RuntimeError("it reads one value of an array: the arrays of FMI 3 are not supported")
    return found


def measured(importer: str, name: str, fmi: int) -> list[float] | str:
    """Final outputs, found in a process of its own, or why there are none."""
    command = [sys.executable, __file__, importer, name, str(fmi)]
    try:
        result = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S)
    except subprocess.TimeoutExpired:
        return f"does not end within {TIMEOUT_S} s"
    if result.returncode != 0:
        lines = [line for line in result.stderr.splitlines() if line.strip()]
        return f"crashes with signal {-result.returncode}" if result.returncode < 0 else lines[-1].strip()
    found: list[float] = json.loads(result.stdout.splitlines()[-1])  # libraries print, too
    return found


def difference(found: list[float], expected: list[float]) -> float:
    """Largest relative difference; values that are not a number must be so in both."""
    if [v != v for v in found] != [v != v for v in expected]:
        return float("inf")
    return max((abs(a - b) / max(1.0, abs(b)) for a, b in zip(found, expected, strict=True) if b == b), default=0.0)


def table() -> str:
    """The whole document."""
    present = {}
    for title, (package, _) in IMPORTERS.items():
        with contextlib.suppress(PackageNotFoundError):
            present[title] = f"{title} ({package} {version(package)})"
    others = [title for title in present if title != "FMPy"]
    rows = [
        "| FMU | FMI | " + " | ".join(present[title] for title in others) + " |",
        "|---|---|" + "---|" * len(others),
    ]
    causes: dict[str, int] = {}
    fmus = [(name, fmi) for name in [*component_names(), *diagnoser_ids()] for fmi in (2, 3)]
    with ThreadPoolExecutor(PROCESSES) as pool:
        found = {(title, *fmu): pool.submit(measured, title, *fmu) for fmu in fmus for title in ["FMPy", *others]}
        for name, fmi in fmus:
            expected = found["FMPy", name, fmi].result()
            if isinstance(expected, str):
                raise RuntimeError(f"FMPy, {name}, FMI {fmi}: {expected}")
            cells = [_cell(title, found[title, name, fmi].result(), expected, causes) for title in others]
            rows.append(f"| `{name}` | {fmi} | {' | '.join(cells)} |")
            print(rows[-1], flush=True)
    numbered = "".join(f"{number}. {cause}\n" for cause, number in causes.items())
    return HEADER.format(
        fmpy=version("fmpy"), rows="\n".join(rows) + "\n", causes=numbered and f"Why not:\n\n{numbered}"
    )


def _cell(title: str, found: list[float] | str, expected: list[float], causes: dict[str, int]) -> str:
    """The difference, or the number of the cause why there is none."""
    if isinstance(found, str):
        cause = re.sub(r"FMU '[^']*\.fmu'", "the FMU", f"{title}: {found.partition('Error: ')[2] or found}")
        return f"no ({causes.setdefault(cause, len(causes) + 1)})"
    error = difference(found, expected)
    return "0" if error == 0 else f"{error:.0e}" + ("" if error <= TOLERANCE else " **differs**")


def main() -> None:
    """Without arguments the table; with importer, FMU and version one cell as JSON."""
    if len(sys.argv) == 1:
        TABLE.write_text(table(), encoding="utf-8")
        return
    importer, name, fmi = sys.argv[1:]
    with contextlib.redirect_stdout(io.StringIO()):  # importers are talkative
        values = final_values(importer, name, int(fmi))
    print(json.dumps(values))


if __name__ == "__main__":
    main()
