"""An exported SSP archive comes to the verdict of `rotordx run` in the tools that read such archives."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import fmpy
import pytest
from ssp_archives import CHANGES as OTHER_CHANGES
from ssp_archives import STEP, exported, rewritten, without_parameter_sets

from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.scenario import load_scenario
from tests.importers import importer

pytestmark = pytest.mark.xdist_group("ssp")  # one process compiles the FMUs

CHANGES = OTHER_CHANGES | {"seed": 1}  # of the packaged scenario, so that plant and sensors are compiled once
STEPS = round(CHANGES["duration_s"] / STEP)
VERDICT = ("detection_time", "isolation_time", "faulty_rotor")
#: The command reaches the diagnoser through esc, plant and sensors; the diagnoser's filters spread that delay.
LONGEST_DELAY = 10 * STEP

Verdict = dict[str, float]


@pytest.fixture(scope="module")
def archive(tmp_path_factory) -> Path:
    return exported(tmp_path_factory.mktemp("ssp"), **CHANGES)


@pytest.fixture(scope="module")
def with_outputs(tmp_path_factory) -> Path:
    return exported(tmp_path_factory.mktemp("ssp"), outputs=True, **CHANGES)


@pytest.fixture(scope="module")
def flown():
    return fly(load_scenario("avram_circle", **CHANGES))


@pytest.fixture(scope="module")
def here(flown) -> Verdict:
    return {name: flown.signals[f"fdie.{name}"][-1] for name in VERDICT}


def delayed(here: Verdict, there: Verdict) -> bool:
    """Whether a verdict is that of `rotordx run`, but somewhat later.

    These tools step all FMUs with the values of the step before: each connection that goes forward adds a step.
    """
    assert here["faulty_rotor"] == there["faulty_rotor"] == 3
    late = [there[name] - here[name] for name in ("detection_time", "isolation_time")]
    return all(0 < seconds <= LONGEST_DELAY + 1e-9 for seconds in late)


def in_ecos(path: Path, **parameter_set: str) -> Verdict:
    ecospy = importer("ecospy")
    with ecospy.EcosSimulation(step_size=STEP, ssp_path=str(path)) as simulation:
        simulation.init(**parameter_set)
        simulation.step(STEPS)
        return {name: simulation.get_real(f"fdie::{name}") for name in VERDICT}


def in_libcosim(path: Path) -> Verdict:
    CosimExecution = importer("libcosimpy.CosimExecution").CosimExecution
    CosimObserver = importer("libcosimpy.CosimObserver").CosimObserver
    execution = CosimExecution.from_ssp_file(ssp_path=str(path), step_size=round(1e9 * STEP))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    execution.step(STEPS)
    slave = {info.name.decode(): info.index for info in execution.slave_infos()}["fdie"]
    references = {v.name.decode(): v.reference for v in execution.slave_variables(slave)}
    return dict(zip(VERDICT, observer.last_real_values(slave, [references[n] for n in VERDICT]), strict=True))


def in_fmpy(path: Path) -> Verdict:
    """FMPy applies no parameter bindings."""
    from fmpy.ssp.simulation import simulate_ssp

    result = simulate_ssp(str(path), stop_time=CHANGES["duration_s"], step_size=STEP)
    return {name: float(result[f"fdie.{name}"][-1]) for name in VERDICT}


def container(path: Path, folder: Path, *, sequential: bool) -> Path:
    """The FMU that fmu-manipulation-toolbox makes of an archive; it takes no notice of parameter sets."""
    assembly = importer("fmu_manipulation_toolbox.assembly").Assembly(path.name, fmu_directory=path.parent)
    assembly.root.sequential = sequential
    assembly.make_fmu(filename=str(folder / "container.fmu"))
    return folder / "container.fmu"


def in_container(path: Path, names: list[str]) -> dict[str, float]:
    result = fmpy.simulate_fmu(str(path), stop_time=CHANGES["duration_s"], step_size=STEP, output=names)
    return {name: float(result[name][-1]) for name in names}


@pytest.mark.parametrize("fly_elsewhere", [in_ecos, in_libcosim, in_fmpy])
def test_verdicts_are_the_same_but_for_the_order_of_computation(
    archive, here, fly_elsewhere: Callable[[Path], Verdict]
):
    assert delayed(here, fly_elsewhere(archive))


@pytest.mark.parametrize("fly_elsewhere", [in_ecos, in_libcosim])
def test_parameter_sets_say_what_the_fmus_start_with(archive, tmp_path, fly_elsewhere: Callable[..., Verdict]):
    bare = rewritten(archive, tmp_path / "bare.ssp", without_parameter_sets)
    sets = {"parameter_set": "initialValues"} if fly_elsewhere is in_ecos else {}
    assert fly_elsewhere(bare) == fly_elsewhere(archive, **sets)


def test_a_parameter_set_that_is_edited_counts(archive, tmp_path):
    """A fault in rotor 2 instead of 3."""
    with zipfile.ZipFile(archive) as content:
        text = content.read("resources/esc.ssv").decode()
    old, new = (f'name="fault_rotor[1]">\n      <ssv:Real value="{rotor}.0"' for rotor in (3, 2))
    assert old in text
    files = {"resources/esc.ssv": text.replace(old, new).encode()}
    path = rewritten(archive, tmp_path / "edited.ssp", files=files)
    assert in_ecos(path, parameter_set="initialValues")["faulty_rotor"] == 2
    assert [fault.rotor for fault in load_scenario(path).faults] == [2]


def test_a_container_comes_to_the_verdict(with_outputs, here, tmp_path):
    names = [f"fdie_{name}" for name in VERDICT]
    values = in_container(container(with_outputs, tmp_path, sequential=False), names)
    assert delayed(here, {name: values[f"fdie_{name}"] for name in VERDICT})


def test_a_sequential_container_is_the_same_flight(with_outputs, flown, here, tmp_path):
    """The elements stand in the order of computation, so that a container that keeps it adds no delay."""
    names = [f"fdie_{name}" for name in VERDICT] + [f"plant_position_{i}" for i in (1, 2, 3)]
    values = in_container(container(with_outputs, tmp_path, sequential=True), names)
    assert {name: values[f"fdie_{name}"] for name in VERDICT} == here
    position = [values[f"plant_position_{i}"] for i in (1, 2, 3)]
    assert position == pytest.approx(flown.signals["plant.position"][-1].tolist(), abs=1e-9)


README = (Path(__file__).parents[2] / "orchestrator" / "README.md").read_text(encoding="utf-8")


def test_the_commands_of_the_readme_work_as_printed(tmp_path):
    """They come to the figures in its table."""
    for name in ("ecospy", "libcosimpy", "fmu_manipulation_toolbox"):
        importer(name)
    section = README[README.index("### Systems\n") : README.index("[compatibility.md]")]
    commands, code = re.findall(r"^```(?:python)?\n(.*?)^```", section, re.MULTILINE | re.DOTALL)
    environment = os.environ | {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    for command in commands.splitlines():
        subprocess.run(command.split(), cwd=tmp_path, env=environment, check=True, capture_output=True)
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, check=True, capture_output=True, text=True
    )
    told = dict(re.findall(r"^(\w+): ([\d.]+)$", result.stdout, re.MULTILINE))
    header, *_, last = (tmp_path / "container.csv").read_text().splitlines()
    told["container"] = dict(zip(header.replace('"', "").split(","), last.split(","), strict=True))[
        "fdie_isolation_time"
    ]
    [there] = re.findall(r"^\| Ecos, libcosim, FMPy, container \|.*\| ([\d.]+) s \|$", section, re.MULTILINE)
    assert {tool: round(float(time), 3) for tool, time in told.items()} == dict.fromkeys(
        ("Ecos", "libcosim", "container"), float(there)
    )
