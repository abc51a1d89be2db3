"""A scenario exported as SSP 1.0 holds all that it is and comes back as the same flight, which runs our own FMUs."""

from __future__ import annotations

import io
import subprocess
import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import fmpy
import numpy as np
import pytest
from click.testing import CliRunner
from fmi3_fmu import Float64
from fmi3_fmu import build as build_fmi3
from ssp_archives import CHANGES, FAULT, STEP, exported, rewritten, structure, without_compiler, without_parameter_sets

from rotordx.orchestrator.cli import main
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.export import fmu_export, ssp_export
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.scenario import load_scenario
from rotordx.orchestrator.ssp_archive import NAMESPACES
from rotordx.orchestrator.system import System
from tests.orchestrator.foreign_fmu import build


@pytest.fixture(scope="module", autouse=True)
def nothing_is_compiled():
    """The installed FMUs fly in the place of ours."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fmu_export, "library", without_compiler)
        yield


@pytest.fixture(scope="module")
def archive(tmp_path_factory) -> Path:
    return exported(tmp_path_factory.mktemp("ssp"))


@pytest.fixture(scope="module")
def flown():
    return fly(load_scenario("avram_circle", **CHANGES))


def bits(recording) -> dict[str, bytes]:
    return {key: values.tobytes() for key, values in recording.signals.items()}


@pytest.mark.parametrize("change", [str, without_parameter_sets], ids=["as it is", "without parameter sets"])
def test_it_comes_back_as_the_same_flight_bit_for_bit(archive, flown, tmp_path, change):
    scenario = load_scenario(rewritten(archive, tmp_path / "flight.ssp", change))
    assert (scenario.seed, scenario.duration_s, scenario.step_size_s) == (5, 5.5, STEP)
    assert [fault.model_dump(exclude_none=True) for fault in scenario.faults] == [FAULT | {"profile": "abrupt"}]
    again = fly(scenario)
    assert bits(again) == bits(flown)
    assert again.units == flown.units


def test_all_values_are_start_values_of_the_fmus(archive):
    with zipfile.ZipFile(archive) as content:
        for name in ("controller", "reference", "esc", "plant", "sensors", "fdie"):
            description = fmpy.read_model_description(io.BytesIO(content.read(f"resources/{name}.fmu")))
            starts = {v.name: v.start for v in description.modelVariables}
            parameters = ET.fromstring(content.read(f"resources/{name}.ssv"))
            values = {p.get("name"): p[0].get("value") for p in parameters.findall(".//ssv:Parameter", NAMESPACES)}
            assert len(values) >= 8
            assert {key: float(starts[key]) for key in values} == {key: float(v) for key, v in values.items()}
            assert float(description.defaultExperiment.stepSize) == STEP


def test_vehicle_step_profile_and_enumerations_come_back(tmp_path):
    fault = {"rotor": 2, "onset_s": 0.2, "loss_of_effectiveness": 0.2, "profile": "intermittent"}
    fault |= {"on_time_s": 0.1, "off_time_s": 0.05, "end_s": 0.4}
    changes = {"vehicle": "crazyflie", "faults": [fault], "duration_s": 0.5, "parameters": {"trajectory": "ellipse"}}
    changes |= {"step_size_s": 0.001}
    path = rewritten(exported(tmp_path, **changes), tmp_path / "bare.ssp", without_parameter_sets)
    scenario = load_scenario(path)
    assert (scenario.vehicle, scenario.step_size_s) == ("crazyflie", 0.001)
    assert scenario.components["reference"].parameters["trajectory"] == "ellipse"
    assert [f.model_dump(exclude_none=True) for f in scenario.faults] == [fault]
    assert bits(fly(scenario)) == bits(fly(load_scenario("avram_circle", **(CHANGES | changes))))


def test_the_command_writes_it_and_runs_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    runner = CliRunner()
    fault = "faults=[{rotor = 3, onset_s = 5.0, loss_of_effectiveness = 0.3}]"
    command = ["export", "ssp", "avram_circle", "--set", "duration_s=0.5", "--set", "seed=5", "--set", fault]
    result = runner.invoke(main, command)
    assert result.exit_code == 0, result.output
    assert "6 FMUs, 0.5 s at 0.002 s" in result.output
    before = Path("avram_circle.ssp").read_bytes()
    runner.invoke(main, command)
    assert Path("avram_circle.ssp").read_bytes() == before, "the same export gives the same bytes"
    result = runner.invoke(main, ["run", "avram_circle.ssp", "--seed", "2", "--out", "flown"])
    assert result.exit_code == 0, result.output
    assert Path("flown/report.html").is_file()


def test_it_tells_what_takes_time(monkeypatch):
    def library(name, code, target, report):
        report(f"compiling {name}")
        return without_compiler(name)

    monkeypatch.setattr(fmu_export, "library", library)
    told: list[str] = []
    ssp_export.contents(load_scenario("avram_circle", **CHANGES), report=told.append)
    assert told == ["3 of 6: compiling esc", "4 of 6: compiling plant", "5 of 6: compiling sensors"]


def test_units_and_parameters_are_in_it(archive):
    root = structure(archive)
    with zipfile.ZipFile(archive) as content:
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


def test_outputs_of_the_system_are_left_aside(flown, tmp_path):
    path = exported(tmp_path, outputs=True)
    connectors = structure(path).findall("ssd:System/ssd:Connectors/ssd:Connector", NAMESPACES)
    assert len(connectors) == sum(values[0].size for values in flown.signals.values())
    assert bits(fly(load_scenario(path))) == bits(flown)


def replaced_fdie(archive: Path, folder: Path, library: bytes | None, change=lambda text: text) -> Path:
    """The archive with another fdie: its library, and its model description changed."""
    with zipfile.ZipFile(archive) as content, zipfile.ZipFile(io.BytesIO(content.read("resources/fdie.fmu"))) as fmu:
        contents = {name: fmu.read(name) for name in fmu.namelist()}
    contents["modelDescription.xml"] = change(contents["modelDescription.xml"].decode()).encode()
    binary = next(name for name in contents if name.startswith("binaries/"))
    contents[binary] = library or contents[binary]
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as fmu:
        for name, data in contents.items():
            fmu.writestr(name, data)
    return rewritten(archive, folder / "replaced.ssp", files={"resources/fdie.fmu": packed.getvalue()})


def test_a_library_that_claims_to_be_ours_is_never_loaded(archive, flown, tmp_path):
    """The installed FMU flies in its place."""
    source = tmp_path / "claim.c"
    source.write_text(f"""#include <stdio.h>
    __attribute__((constructor)) static void loaded(void) {{ fclose(fopen("{tmp_path}/loaded", "w")); }}""")
    subprocess.run(["cc", "-shared", "-fPIC", "-o", str(tmp_path / "claim.so"), str(source)], check=True)
    path = replaced_fdie(archive, tmp_path, (tmp_path / "claim.so").read_bytes())
    scenario = load_scenario(path)
    assert scenario.components["fdie"].fmu == "fdie"
    assert bits(fly(scenario)) == bits(flown)
    assert not (tmp_path / "loaded").exists()


@pytest.mark.parametrize(
    ("old", "new"),
    [('guid="{', 'guid="{0'), ('start="0.002"', 'start="0.004"'), ('name="fault_detected"', 'name="fault_detectet"')],
)
def test_an_fmu_that_differs_from_ours_is_flown_in_a_process_of_its_own(archive, tmp_path, old, new):
    path = replaced_fdie(archive, tmp_path, None, lambda text: text.replace(old, new, 1))
    settings = load_scenario(path).components["fdie"]
    assert settings.fmu.endswith("fdie.fmu")
    assert settings.isolate is None, "which isolates FMUs that are not packaged"


def test_seeds_that_differ_are_kept(archive, tmp_path):
    with zipfile.ZipFile(archive) as content:
        parameters = content.read("resources/sensors.ssv").decode()
    changed = parameters.replace(
        'name="seed">\n      <ssv:Real value="5.0"', 'name="seed">\n      <ssv:Real value="6.0"'
    )
    assert changed != parameters
    path = rewritten(archive, tmp_path / "seeds.ssp", files={"resources/sensors.ssv": changed.encode()})
    scenario = load_scenario(path)
    assert (scenario.seed, scenario.components["sensors"].parameters["seed"]) == (5, 6.0)
    assert "seed" not in scenario.components["plant"].parameters


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<ssv:ParameterSet", "<!DOCTYPE x><ssv:ParameterSet", "'resources/esc.ssv' cannot be read: it has a DOCTYPE"),
        ('name="fault_rotor[1]">\n      <ssv:Real value="3.0"', 'name="fault_rotor[1]">\n      <ssv:Real value="1.5"',
         "faults[0].rotor is 1.5 but must be a rotor, 1 to 4"),
        ('name="fault_profile[1]">\n      <ssv:Real value="0.0"', 'name="fault_profile[1]">\n      <ssv:Real value="9"',
         "fault_profile[1] is 9, but must be 0 to 3"),
    ],
)  # fmt: skip
def test_a_parameter_set_that_cannot_be_is_refused(archive, tmp_path, old, new, message):
    with zipfile.ZipFile(archive) as content:
        text = content.read("resources/esc.ssv").decode()
    assert old in text
    files = {"resources/esc.ssv": text.replace(old, new, 1).encode()}
    with pytest.raises(UserError) as error:
        load_scenario(rewritten(archive, tmp_path / "damaged.ssp", files=files))
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_openmodelica_finds_names_and_a_step_size(tmp_path):
    """What its importer reads: identifiers of C, these prefixes, and its annotation as the first one of the system."""
    path = exported(tmp_path, outputs=True, name="3rd-flight.v2", step_size_s=STEP)
    with zipfile.ZipFile(path) as content:
        assert b"<ssd:System " in content.read("SystemStructure.ssd")
    root = structure(path)
    system = root.find("ssd:System", NAMESPACES)
    names = [root.get("name"), system.get("name")]
    names += [c.get("name") for c in system.findall("ssd:Connectors/ssd:Connector", NAMESPACES)]
    names += [c.get("name") for c in system.findall("ssd:Elements/ssd:Component", NAMESPACES)]
    assert all(name.isidentifier() and name.isascii() and name[0].isalpha() for name in names)
    assert len(set(names)) == len(names) - 1, "the document and its system have one name"
    annotation = system.find("ssd:Annotations/ssc:Annotation", NAMESPACES)
    assert annotation.get("type") == "org.openmodelica"
    master = annotation.find("oms:Annotations/oms:SimulationInformation/oms:FixedStepMaster", NAMESPACES)
    assert (master.get("description"), master.get("stepSize")) == ("oms-ma", "0.002")


def test_an_fmi_3_component_is_refused(tmp_path):
    fmu = build_fmi3(tmp_path, "extra", [Float64("y", "output")], "")
    with pytest.raises(UserError, match=r"components.extra is an FMU of FMI 3, which SSP 1.0 does not know"):
        exported(tmp_path, components={"extra": {"fmu": str(fmu)}})


@pytest.mark.parametrize(("scale", "exact"), [(-1.0, True), (0.3, False)])
def test_scaled_ports_come_back(tmp_path, scale, exact):
    """As linear transformations of their connections."""
    fmu = build(tmp_path, "theirs", inputs=["x", "y"], outputs=["z"], step="V(z) = 2 * V(x) + V(y) * V(y);")
    ports = {"a": {"variables": "x", "scale": scale, "offset": 0.25}}
    ports |= {"b": {"variables": "y", "unit": "km", "offset": 0.5}} if not exact else {"b": {"variables": "y"}}
    connections = [{"from": f"plant.position[{i + 1}]", "to": f"theirs.{port}"} for i, port in enumerate(ports)]
    components = {"theirs": {"fmu": str(fmu), "ports": ports}}
    changes = {"components": components, "connections": connections, "duration_s": 0.1}
    flown = fly(load_scenario("avram_circle", **(CHANGES | changes))).signals
    a, b = flown["plant.position"][1:, 0], flown["plant.position"][1:, 1]
    expected = 2 * (a - 0.25) / scale + (b if exact else (b - 0.5) / 1000) ** 2
    np.testing.assert_allclose(flown["theirs.z"][1:], expected, rtol=1e-12)
    again = fly(load_scenario(exported(tmp_path, **changes))).signals
    if exact:
        assert again["theirs.z"].tobytes() == flown["theirs.z"].tobytes()
    else:
        np.testing.assert_allclose(again["theirs.z"], flown["theirs.z"], rtol=1e-12)


def test_the_export_needs_no_other_process_for_its_own_fmus(archive):
    with System(load_scenario(archive)) as system:
        assert {archive.path.parent.name for archive in system.archives.values()} == {"fmi2"}
