"""A scenario exported as SSP 1.0 is the same flight here, and the same verdict in other tools; so is a foreign SSP."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from click.testing import CliRunner
from fmi3_fmu import Float64
from fmi3_fmu import build as build_fmi3

from rotordx.orchestrator.cli import main
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.scenario import load_scenario
from rotordx.orchestrator.system_structure import NAMESPACES
from tests.importers import importer
from tests.orchestrator.foreign_fmu import build

STEP = 0.002
FAULT = {"rotor": 3, "onset_s": 5.0, "loss_of_effectiveness": 0.3}
CHANGES = {"duration_s": 5.5, "faults": [FAULT], "seed": 5}


def exported(folder: Path, **changes) -> Path:
    """avram_circle with changes as an archive."""
    scenario = load_scenario("avram_circle", **(CHANGES | changes))
    from rotordx.orchestrator.export import fmu_export, ssp_export

    path = folder / "flight.ssp"
    fmu_export.write(ssp_export.contents(scenario), path)
    return path


@pytest.fixture(scope="module")
def archive(tmp_path_factory) -> Path:
    return exported(tmp_path_factory.mktemp("ssp"))


@pytest.fixture(scope="module")
def flown():
    return fly(load_scenario("avram_circle", **CHANGES))


def test_it_comes_back_as_the_same_flight_bit_for_bit(archive, flown):
    scenario = load_scenario(archive)
    assert (scenario.seed, scenario.duration_s, scenario.step_size_s) == (5, 5.5, STEP)
    assert [fault.model_dump(exclude_none=True) for fault in scenario.faults] == [FAULT | {"profile": "abrupt"}]
    again = fly(scenario)
    assert {key: values.tobytes() for key, values in again.signals.items()} == {
        key: values.tobytes() for key, values in flown.signals.items()
    }
    assert again.units == flown.units


@pytest.mark.parametrize("vehicle", ["lab_x", "crazyflie"])
def test_vehicle_profile_and_enumerations_come_back(vehicle, tmp_path):
    fault = {"rotor": 2, "onset_s": 0.2, "loss_of_effectiveness": 0.2, "profile": "intermittent"}
    fault |= {"on_time_s": 0.1, "off_time_s": 0.05, "end_s": 0.4}
    changes = {"vehicle": vehicle, "faults": [fault], "duration_s": 0.5, "parameters": {"trajectory": "ellipse"}}
    path = exported(tmp_path, **changes)
    scenario = load_scenario(path)
    assert scenario.vehicle == vehicle
    assert [f.model_dump(exclude_none=True) for f in scenario.faults] == [fault]
    expected = fly(load_scenario("avram_circle", **(CHANGES | changes)))
    again = fly(scenario)
    assert again.signals["plant.position"].tobytes() == expected.signals["plant.position"].tobytes()


def test_the_command_writes_it_and_runs_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runner = CliRunner()
    result = runner.invoke(main, ["export", "ssp", "avram_circle", "--set", "duration_s=0.5", "--set", "faults=[]"])
    assert result.exit_code == 0, result.output
    assert "6 FMUs, 0.5 s at 0.002 s" in result.output
    before = Path("avram_circle.ssp").read_bytes()
    runner.invoke(main, ["export", "ssp", "avram_circle", "--set", "duration_s=0.5", "--set", "faults=[]"])
    assert Path("avram_circle.ssp").read_bytes() == before, "the same export gives the same bytes"
    result = runner.invoke(main, ["run", "avram_circle.ssp", "--seed", "2", "--out", "flown"])
    assert result.exit_code == 0, result.output
    assert Path("flown/report.html").is_file()


def test_units_and_parameters_are_in_it(archive):
    with zipfile.ZipFile(archive) as content:
        root = ET.fromstring(content.read("SystemStructure.ssd"))
        parameters = ET.fromstring(content.read("resources/esc.ssv"))
    elements = [e.get("name") for e in root.findall(".//ssd:Component", NAMESPACES)]
    assert elements == ["controller", "reference", "esc", "plant", "sensors", "fdie"], "the order of computation"
    connector = root.find(".//ssd:Component[@name='plant']//ssd:Connector[@name='rotor_speed[4]']", NAMESPACES)
    assert connector.get("kind") == "input"
    assert connector[0].get("unit") == "rad/s"
    unit = root.find("ssd:Units/ssc:Unit[@name='rad/s']/ssc:BaseUnit", NAMESPACES)
    assert unit.attrib == {"rad": "1", "s": "-1"}
    values = {p.get("name"): p[0].get("value") for p in parameters.findall(".//ssv:Parameter", NAMESPACES)}
    assert (values["fault_rotor[1]"], values["fault_magnitude[1]"], values["fault_onset[1]"]) == ("3.0", "0.3", "5.0")
    experiment = root.find("ssd:DefaultExperiment", NAMESPACES)
    assert experiment.get("stopTime") == "5.5"


def verdict_in_ecos(path: Path) -> dict[str, float]:
    ecospy = importer("ecospy")
    with ecospy.EcosSimulation(step_size=STEP, ssp_path=str(path)) as simulation:
        simulation.init(parameter_set="initialValues")
        simulation.step(round(CHANGES["duration_s"] / STEP))
        return {
            name: simulation.get_real(f"fdie::{name}") for name in ("detection_time", "isolation_time", "faulty_rotor")
        }


def verdict_in_libcosim(path: Path) -> dict[str, float]:
    CosimExecution = importer("libcosimpy.CosimExecution").CosimExecution
    CosimObserver = importer("libcosimpy.CosimObserver").CosimObserver
    execution = CosimExecution.from_ssp_file(ssp_path=str(path), step_size=round(1e9 * STEP))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    execution.step(round(CHANGES["duration_s"] / STEP))
    slave = {info.name.decode(): info.index for info in execution.slave_infos()}["fdie"]
    references = {v.name.decode(): v.reference for v in execution.slave_variables(slave)}
    names = ("detection_time", "isolation_time", "faulty_rotor")
    return dict(zip(names, observer.last_real_values(slave, [references[n] for n in names]), strict=True))


@pytest.mark.parametrize("fly_elsewhere", [verdict_in_ecos, verdict_in_libcosim])
def test_other_tools_come_to_the_same_verdict_but_for_the_order_of_computation(
    archive, flown, fly_elsewhere: Callable[[Path], dict[str, float]]
):
    """They step all FMUs with the values of the step before: each connection that goes forward adds a step of delay.

    From the command to the diagnoser these are esc, plant, sensors and fdie; the diagnosers' filters spread that delay.
    """
    here = {name: flown.signals[f"fdie.{name}"][-1] for name in ("detection_time", "isolation_time", "faulty_rotor")}
    there = fly_elsewhere(archive)
    assert here["faulty_rotor"] == there["faulty_rotor"] == 3
    for name in ("detection_time", "isolation_time"):
        assert 0 < there[name] - here[name] <= 10 * STEP + 1e-9, name


def rewritten(archive: Path, target: Path, change: Callable[[str], str], **files: bytes) -> Path:
    with zipfile.ZipFile(archive) as source, zipfile.ZipFile(target, "w") as result:
        for name in source.namelist():
            content = source.read(name)
            result.writestr(name, change(content.decode()) if name == "SystemStructure.ssd" else content)
        for name, content in files.items():
            result.writestr(name, content)
    return target


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("resources/esc.fmu", "../esc.fmu"), "the source '../esc.fmu' of esc is not in the"),
        (lambda text: text.replace("resources/esc.ssv", "../esc.ssv"), "the parameter set '../esc.ssv' cannot be read"),
        (lambda text: text.replace("x-fmu-sharedlibrary", "x-ssp-definition"), "controller is no FMU"),
        (lambda text: text.replace(' stopTime="5.5"', ""), "its DefaultExperiment states no stopTime"),
        (lambda text: text[: len(text) // 2], "its SystemStructure.ssd cannot be read"),
        (
            lambda text: text.replace('startConnector="rotor_speed[1]"', 'startConnector="rotor_sped[1]"'),
            "connection from 'esc.rotor_sped.1.': there is no such output",
        ),
    ],
)
def test_a_damaged_structure_is_refused_in_one_sentence(archive, tmp_path, change, message):
    from rotordx.orchestrator.system import System

    path = rewritten(archive, tmp_path / "damaged.ssp", change)
    with pytest.raises(UserError, match=message) as error:
        System(load_scenario(path))
    assert "\n" not in str(error.value)


def test_an_ssp_of_another_tool_is_flown(tmp_path):
    """Elements of an array that cross over, a loop, inline parameters, connections in either direction."""
    build(
        tmp_path,
        "source",
        inputs=["back"],
        outputs=["y[1]", "y[2]"],
        parameters={"k": 1.0},
        step="V(y_1_) = V(k) + V(back); V(y_2_) = 10;",
    )
    build(tmp_path, "sink", inputs=["u[1]", "u[2]"], outputs=["z"], step="V(z) = V(u_1_) - V(u_2_);")
    structure = f"""<?xml version="1.0"?>
<ssd:SystemStructureDescription version="1.0" name="other" xmlns:ssd="{NAMESPACES["ssd"]}"
    xmlns:ssv="{NAMESPACES["ssv"]}" xmlns:ssc="{NAMESPACES["ssc"]}"><ssd:System name="s"><ssd:Elements>
  <ssd:Component name="source" source="resources/source.fmu"><ssd:ParameterBindings><ssd:ParameterBinding>
    <ssd:ParameterValues><ssv:ParameterSet version="1.0" name="p"><ssv:Parameters>
      <ssv:Parameter name="k"><ssv:Real value="3"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet>
    </ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings></ssd:Component>
  <ssd:Component name="sink" source="resources/sink.fmu"/></ssd:Elements><ssd:Connections>
  <ssd:Connection startElement="source" startConnector="y[1]" endElement="sink" endConnector="u[2]"/>
  <ssd:Connection startElement="sink" startConnector="u[1]" endElement="source" endConnector="y[2]"/>
  <ssd:Connection startElement="sink" startConnector="z" endElement="source" endConnector="back"/>
</ssd:Connections></ssd:System><ssd:DefaultExperiment stopTime="0.01"/></ssd:SystemStructureDescription>"""
    with zipfile.ZipFile(tmp_path / "other.ssp", "w") as archive:
        archive.writestr("SystemStructure.ssd", structure)
        for name in ("source", "sink"):
            archive.write(tmp_path / f"{name}.fmu", f"resources/{name}.fmu")
    signals = fly(load_scenario(tmp_path / "other.ssp", step_size_s=0.002)).signals
    expected = [0.0]
    for _ in range(5):
        expected.append(10 - (3 + expected[-1]))
    assert np.array_equal(signals["sink.z"], expected)


def test_an_fmi_3_component_is_refused(tmp_path):
    fmu = build_fmi3(tmp_path, "extra", [Float64("y", "output")], "")
    with pytest.raises(UserError, match=r"components.extra is an FMU of FMI 3, which SSP 1.0 does not know"):
        exported(tmp_path, components={"extra": {"fmu": str(fmu)}})
