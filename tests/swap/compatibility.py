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
from dataclasses import asdict, dataclass
from pathlib import Path

import fmpy
from fmpy.fmi1 import FMICallException

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "orchestrator" / "compatibility.md"
STEP, STEPS = 0.002, 500
TOLERANCE = 1e-12
TIMEOUT_S = 120
PROCESSES = 2

HEADER = """# Compatibility

Written by `make compatibility` (tests/swap/compatibility.py): each FMU in both versions of FMI, 500 steps of 2 ms with
constant inputs, in every importer that pip installs. A number is the largest difference of a final output from the
value that FMPy {fmpy} finds, relative to the larger of 1 and that value; it must be at most 1e-12. CoFMUPy, which needs
an older FMPy, runs in an environment of its own.

{rows}
{remarks}"""


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


@dataclass(frozen=True)
class Outcome:
    """Final outputs, None if there are none, and what is to be said of them."""

    values: list[float] | None
    remark: str = ""


def in_fmpy(
    path: Path, inputs: Mapping[str, list[float]], outputs: Mapping[str, int], validate: bool = True
) -> list[float]:
    """FMPy's own classes, called in the order of the standard."""
    description = fmpy.read_model_description(str(path), validate=validate)
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


def in_container(path: Path, inputs: Mapping[str, list[float]], outputs: Mapping[str, int]) -> Outcome:
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
        fmi = int(fmpy.read_model_description(str(path), validate=False).fmiVersion[0])
        Assembly("container.json", fmu_directory=place).make_fmu(fmi_version=fmi)
        try:
            return Outcome(in_fmpy(place / "container.fmu", inputs, outputs))
        except fmpy.model_description.ValidationError as error:
            problem = str(error).splitlines()[-1].lstrip("- ")
            remark = f"read without validation, as the modelDescription.xml that it writes is not valid: {problem}"
            return Outcome(in_fmpy(place / "container.fmu", inputs, outputs, validate=False), remark)


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


def in_fmuloader(path: Path, inputs: Mapping[str, list[float]], outputs: Mapping[str, int]) -> list[float]:
    """The classes of fmuloader, which leaves the model description to FMPy."""
    description = fmpy.read_model_description(str(path))
    references = {v.name: v.valueReference for v in description.modelVariables}
    identifier = description.coSimulation.modelIdentifier
    if description.fmiVersion.startswith("2"):
        from fmuloader.fmi2 import Fmi2Slave, Fmi2Type

        fmu = Fmi2Slave(path, model_identifier=identifier)
        fmu.instantiate("fmu", Fmi2Type.CO_SIMULATION, guid=description.guid)
        fmu.setup_experiment(start_time=0.0)
        setter, getter = fmu.set_real, fmu.get_real
    else:
        from fmuloader.fmi3 import Fmi3Slave

        fmu = Fmi3Slave(path, model_identifier=identifier)
        fmu.instantiate_co_simulation("fmu", instantiation_token=description.guid)
        setter, getter = fmu.set_float64, fmu.get_float64
    fmu.enter_initialization_mode()
    for name, values in inputs.items():
        setter([references[name]], values)
    fmu.exit_initialization_mode()
    for k in range(STEPS):
        fmu.do_step(k * STEP, STEP)
    try:
        found: list[float] = [value for name in outputs for value in getter([references[name]])]
    except Exception as error:
        raise RuntimeError(
            f"it asks for one value of each value reference, which FMI 3 arrays refuse: {error}"
        ) from error
    fmu.terminate()
    fmu.free_instance()
    return found


def in_cofmupy(path: Path, inputs: Mapping[str, list[float]], outputs: Mapping[str, int]) -> list[float]:
    """CoFMUPy's coordinator."""
    from cofmupy.coordinator import Coordinator

    initial = {name: values if len(values) > 1 else values[0] for name, values in inputs.items()}
    coordinator = Coordinator()
    try:
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
    except (ValueError, FMICallException) as error:
        raise RuntimeError(f"the arrays of FMI 3 are not supported: {error}") from error
    results = coordinator.get_results()
    return [float(results["fmu", name][-1]) for name in outputs]


@dataclass(frozen=True)
class Importer:
    """A tool, the function that runs an FMU in it, and the Python that has it."""

    distribution: str
    run: Callable[[Path, Mapping[str, list[float]], Mapping[str, int]], list[float] | Outcome]
    python: str = sys.executable

    @property
    def version(self) -> str | None:
        """Its version; None: it is not installed."""
        code = f"from importlib.metadata import version; print(version({self.distribution!r}))"
        try:
            result = subprocess.run([self.python, "-c", code], capture_output=True, text=True)
        except FileNotFoundError:
            return None
        return result.stdout.strip() or None


IMPORTERS = {
    "FMPy": Importer("fmpy", in_fmpy),
    "Ecos": Importer("ecospy", in_ecos),
    "libcosim": Importer("libcosimpy", in_libcosim),
    "container": Importer("fmu-manipulation-toolbox", in_container),
    "pathsim": Importer("pathsim-fmi", in_pathsim),
    "fmuloader": Importer("fmuloader", in_fmuloader),
    "CoFMUPy": Importer("cofmupy", in_cofmupy, str(ROOT / "build" / "cofmupy" / "bin" / "python")),
}


def found_here(importer: str, path: Path) -> Outcome:
    """What an importer finds in this process."""
    description = fmpy.read_model_description(str(path), validate=False)
    outputs = {
        v.name: int(v.dimensions[0].start) if v.dimensions else 1
        for v in description.modelVariables
        if v.causality == "output"
    }
    found = IMPORTERS[importer].run(path, values_of(description), outputs)
    result = found if isinstance(found, Outcome) else Outcome(found)
    if result.values is not None and len(result.values) < sum(outputs.values()):
        return Outcome(None, "it reads one value of an array: the arrays of FMI 3 are not supported")
    return result


def outcome(importer: str, path: Path) -> Outcome:
    """What an importer finds in a process of its own."""
    command = [IMPORTERS[importer].python, __file__, importer, str(path)]
    try:
        result = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S)
    except subprocess.TimeoutExpired:
        return Outcome(None, f"does not end within {TIMEOUT_S} s")
    if result.returncode < 0:
        return Outcome(None, f"crashes with signal {-result.returncode}")
    if result.returncode > 0:
        last = [line for line in result.stderr.splitlines() if line.strip()][-1].strip()
        return Outcome(None, last.partition("Error: ")[2] or last)
    return Outcome(**json.loads(result.stdout.splitlines()[-1]))  # libraries print, too


def difference(found: list[float], expected: list[float]) -> float:
    """Largest relative difference; values that are not a number must be so in both."""
    if [v != v for v in found] != [v != v for v in expected]:
        return float("inf")
    return max((abs(a - b) / max(1.0, abs(b)) for a, b in zip(found, expected, strict=True) if b == b), default=0.0)


def table() -> str:
    """The whole document."""
    from rotordx.fmus import component_names, diagnoser_ids, fmu_path

    versions = {title: importer.version for title, importer in IMPORTERS.items()}
    others = [title for title in IMPORTERS if title != "FMPy" and versions[title]]
    titles = [f"{title} ({IMPORTERS[title].distribution} {versions[title]})" for title in others]
    rows = ["| FMU | FMI | " + " | ".join(titles) + " |", "|---|---|" + "---|" * len(others)]
    remarks: dict[str, int] = {}
    fmus = [(name, fmi) for name in [*component_names(), *diagnoser_ids()] for fmi in (2, 3)]
    with ThreadPoolExecutor(PROCESSES) as pool:
        found = {(t, *fmu): pool.submit(outcome, t, fmu_path(*fmu)) for fmu in fmus for t in ["FMPy", *others]}
        for name, fmi in fmus:
            expected = found["FMPy", name, fmi].result()
            if expected.values is None:
                raise RuntimeError(f"FMPy, {name}, FMI {fmi}: {expected.remark}")
            cells = [_cell(title, found[title, name, fmi].result(), expected.values, remarks) for title in others]
            rows.append(f"| `{name}` | {fmi} | {' | '.join(cells)} |")
            print(rows[-1], flush=True)
    numbered = "".join(f"{number}. {remark}\n" for remark, number in remarks.items())
    return HEADER.format(
        fmpy=versions["FMPy"], rows="\n".join(rows) + "\n", remarks=numbered and f"Remarks:\n\n{numbered}"
    )


def _cell(title: str, found: Outcome, expected: list[float], remarks: dict[str, int]) -> str:
    """The difference or "no", and the number of the remark on it."""
    if found.values is None:
        cell = "no"
    else:
        error = difference(found.values, expected)
        cell = "0" if error == 0 else f"{error:.0e}" + ("" if error <= TOLERANCE else " **differs**")
    if found.remark:
        remark = re.sub(r"FMU '[^']*\.fmu'", "the FMU", f"{title}: {found.remark}")
        cell += f" ({remarks.setdefault(remark, len(remarks) + 1)})"
    return cell


def main() -> None:
    """Without arguments the table; with an importer and the path of an FMU one outcome as JSON."""
    if len(sys.argv) == 1:
        TABLE.write_text(table(), encoding="utf-8")
        return
    importer, path = sys.argv[1:]
    with contextlib.redirect_stdout(io.StringIO()):  # importers are talkative
        result = found_here(importer, Path(path))
    print(json.dumps(asdict(result)))


if __name__ == "__main__":
    main()
