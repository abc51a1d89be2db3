"""Compilers of the exported C, and programs made with them."""

from __future__ import annotations

import json
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotordx.fmus import load_component
from rotordx.fmus.diagnosers.interface import Inputs
from rotordx.fmus.shell.ports import Component, table
from rotordx.orchestrator.export import c_export
from rotordx.orchestrator.export.subject import Subject, subject
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.layout import load_layout
from rotordx.orchestrator.scenario import load_scenario

HERE = Path(__file__).parent
PRECISIONS = {"double": [], "single": ["-DROTORDX_SINGLE"]}
STRICT = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-ffp-contract=off"]
CORTEX_M7 = ["arm-none-eabi-gcc", "-mcpu=cortex-m7", "-mfpu=fpv5-d16", "-mthumb", "-mfloat-abi=hard"]
CORTEX_M4F = ["arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16", "-mthumb", "-mfloat-abi=hard"]
EMULATOR = ["qemu-system-arm", "-M", "mps2-an500", "-cpu", "cortex-m7", "-nographic", "-icount", "shift=0",
            "-semihosting-config", "enable=on,target=native", "-kernel", "cortex_m7.elf"]  # fmt: skip

#: inputs or outputs of a flight, one row a step
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Export:
    """An export on disk."""

    subject: Subject
    folder: Path

    @property
    def diagnoser(self) -> str:
        return self.subject.diagnoser

    @property
    def source(self) -> Path:
        return self.folder / f"rotordx_{self.diagnoser}.c"


def export(diagnoser: str, folder: Path, vehicle: str = "lab_x", wrappers: tuple[str, ...] = ()) -> Export:
    exported = subject(diagnoser, vehicle)
    c_export.write(c_export.contents(exported, wrappers), folder)
    return Export(exported, folder)


def run(command: list[Any], folder: Path | None = None, **options: Any) -> str:
    """Output of a command; both outputs are in the message if it fails."""
    result = subprocess.run([*map(str, command)], cwd=folder, capture_output=True, text=True, check=False, **options)
    assert result.returncode == 0, f"{' '.join(map(str, command))}\n{result.stdout}\n{result.stderr}"
    return result.stdout


def flown(diagnoser: str, **changes: Any) -> tuple[Array, Array]:
    """Inputs (steps, inputs) and the FMU's outputs (steps, outputs) of avram_circle, changed."""
    scenario = load_scenario("avram_circle", **({"diagnosers": [diagnoser]} | changes))
    recording = fly(scenario)
    sources = load_layout(scenario.system).diagnoser_inputs
    component: Component = load_component(diagnoser)
    keys = [sources[p.name] for p in table(Inputs)], [f"{diagnoser}.{p.name}" for p in table(component.outputs)]
    inputs, outputs = (
        np.hstack([recording.signals[key].reshape(len(recording.time), -1)[1:] for key in side]) for side in keys
    )
    return np.ascontiguousarray(inputs), outputs


def host_program(export: Export, precision: str, folder: Path, compiler: str = "gcc") -> Path:
    """The harness around an export."""
    program = folder / "harness"
    run([compiler, *STRICT, "-O2", *_harness(export), *PRECISIONS[precision], "-lm", "-o", program])
    return program


def played(program: list[Any], inputs: Array, folder: Path) -> Array:
    """Outputs (steps, outputs) of a harness that runs in a folder."""
    inputs.tofile(folder / "inputs.bin")
    run(program, folder, timeout=600)
    return np.fromfile(folder / "outputs.bin").reshape(len(inputs), -1)


def cortex_m7_program(export: Export, precision: str, folder: Path) -> dict[str, int]:
    """Makes `cortex_m7.elf` for the emulator; code size and stack of the diagnoser in bytes."""
    chosen = [*CORTEX_M7, "-O2", "-fno-math-errno", *PRECISIONS[precision]]
    run([*chosen, *STRICT, "-Wdouble-promotion" if precision == "single" else "-Wall", "-fstack-usage",
         "-c", export.source, "-o", "diagnoser.o"], folder)  # fmt: skip
    harness = [part for part in _harness(export) if part != export.source]
    run([*chosen, "-std=c99", *harness, "diagnoser.o", "-DMEASURED", HERE / "cortex_m7.c", "-T", HERE / "cortex_m7.ld",
         "-nostartfiles", "--specs=rdimon.specs", "-lm", "-o", "cortex_m7.elf"], folder)  # fmt: skip
    text, data = run(["arm-none-eabi-size", "diagnoser.o"], folder).splitlines()[1].split()[:2]
    frames = [line.split("\t") for line in (folder / "diagnoser.su").read_text().splitlines()]
    stack = sum(int(size) for where, size, _ in frames if "_step" in where.rsplit(":", 1)[-1])
    return {"code_bytes": int(text) + int(data), "stack_bytes": stack}


def measured_steps(folder: Path) -> dict[str, int]:
    """What the emulated flight wrote about its steps."""
    figures: dict[str, int] = json.loads((folder / "figures.json").read_text())
    return figures


def same_verdict(outputs: Array, answers: Array, step_size: float) -> bool:
    """Same verdict and rotor in the end, and their times within one step."""
    times = np.abs(outputs[-1, 6:8] - answers[-1, 6:8])
    together = np.array_equal(np.isnan(outputs[-1, 6:8]), np.isnan(answers[-1, 6:8]))
    return bool(together and np.array_equal(outputs[-1, :2], answers[-1, :2]) and not (times > 1.01 * step_size).any())


def loss_difference(outputs: Array, answers: Array) -> float:
    """Largest difference of the loss of effectiveness while both name the same rotor."""
    same = outputs[:, 1] == answers[:, 1]
    return float(np.abs(outputs[same, 2:6] - answers[same, 2:6]).max())


def _harness(export: Export) -> list[Any]:
    vehicle = export.subject.vehicle.name
    include = ["-include", f"rotordx_{export.diagnoser}.h", f"-I{export.folder}"]
    return [f"-DDIAGNOSER={export.diagnoser}", f"-DVEHICLE={vehicle}", *include, export.source, HERE / "harness.c"]
