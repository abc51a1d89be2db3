"""SSP archives of other tools fly as SSP 1.0 says, and what cannot be flown is refused in one sentence."""

from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest
from ssp_archives import (
    STRUCTURE,
    bindings,
    component,
    connection,
    connector,
    connectors,
    entry,
    linear,
    mapping,
    parameter,
    system,
    within,
    written,
)

from rotordx.orchestrator import ssp_archive
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.flight import fly
from rotordx.orchestrator.scenario import load_scenario
from rotordx.orchestrator.system import System
from tests.orchestrator.foreign_fmu import build

STEP = 0.002


def signals(path: Path) -> dict[str, np.ndarray]:
    """Flown in this process, which is quicker."""
    scenario = load_scenario(path, step_size_s=STEP)
    components = {name: c | {"isolate": False} for name, c in scenario.plain()["components"].items()}
    return fly(scenario.changed(components=components)).signals


def last(path: Path, signal: str) -> float:
    return float(signals(path)[signal][-1])


@pytest.fixture(scope="module")
def fmus(tmp_path_factory) -> dict[str, Path]:
    """`ten` gives 10, `gain` gives k u, `sum` adds the elements of an array with weights."""
    folder = tmp_path_factory.mktemp("fmus")
    return {
        "ten": build(folder, "ten", outputs=["y"], step="V(y) = 10;"),
        "gain": build(folder, "gain", inputs=["u"], outputs=["y"], parameters={"k": 1.0}, step="V(y) = V(k) * V(u);"),
        "pair": build(folder, "pair", inputs=["back"], outputs=["y[1]", "y[2]"], parameters={"k": 1.0},
                      step="V(y_1_) = V(k) + V(back); V(y_2_) = 10;"),
        "sum": build(folder, "sum", inputs=["u[1]", "u[2]"], outputs=["z"], step="V(z) = V(u_1_) - V(u_2_);"),
    }  # fmt: skip


def test_arrays_loops_and_connections_in_either_direction(tmp_path, fmus):
    """Elements of an array that cross over, a loop, inline parameters."""
    text = system(
        component("pair", inside=bindings(parameter("k", "3"))) + component("sum"),
        connection("pair.y[1]", "sum.u[2]") + connection("sum.u[1]", "pair.y[2]") + connection("sum.z", "pair.back"),
    )
    flown = signals(written(tmp_path, text, fmus["pair"], fmus["sum"]))
    expected = [0.0]
    for _ in range(5):
        expected.append(10 - (3 + expected[-1]))
    assert np.array_equal(flown["sum.z"], expected)


def test_connections_are_transformed(tmp_path, fmus):
    """target = factor * source + offset, each element of an array on its own."""
    text = system(
        component("ten") + component("gain") + component("sum"),
        connection("ten.y", "gain.u", linear(factor=-0.5, offset=1))
        + connection("gain.y", "sum.u[1]", linear(offset=3))
        + connection("sum.u[2]", "gain.y", linear(factor=2)),
    )
    path = written(tmp_path, text, *fmus.values())
    assert last(path, "gain.y") == -4
    assert last(path, "sum.z") == (-4 + 3) - 2 * -4


def test_units_are_converted_before_the_transformation_unless_suppressed(tmp_path, fmus):
    bases = {"km": 'm="1" factor="1000"', "m": 'm="1"', "s": 's="1"'}
    units = "".join(f'<ssc:Unit name="{name}"><ssc:BaseUnit {base}/></ssc:Unit>' for name, base in bases.items())
    units = f"<ssd:Units>{units}</ssd:Units>"

    def text(change: str, attributes: str = "", unit: str = "m") -> str:
        elements = component("ten", inside=connectors(connector("y", "output", "km")))
        elements += component("gain", inside=connectors(connector("u", "input", unit)))
        return system(elements, connection("ten.y", "gain.u", change, attributes))

    fly_with = [fmus["ten"], fmus["gain"]]
    assert last(written(tmp_path, text(linear(factor=2, offset=5)), *fly_with, units=units), "gain.y") == 20005
    suppressed = text(linear(factor=2, offset=5), 'suppressUnitConversion="true"')
    assert last(written(tmp_path, suppressed, *fly_with, units=units), "gain.y") == 25
    with pytest.raises(UserError, match=r"the connection from ten\.y to gain\.u is in m where s is needed"):
        load_scenario(written(tmp_path, text("", unit="s"), *fly_with, units=units))


def nested(**bound: str) -> str:
    """ten -> outer(inner(gain: k u) -> gain: k u) -> the system's output; `bound`: bindings at each level."""
    port = connectors(connector("in", "input"), connector("out", "output"))
    inner = system(
        component("gain", inside=bound.get("gain", "")),
        connection("in", "gain.u", linear(factor=3)) + connection("gain.y", "out"),
        own=port + bound.get("inner", ""),
    )
    outer = system(
        within("inner", inner) + component("gain"),
        connection("in", "inner.in", linear(offset=1))
        + connection("inner.out", "gain.u")
        + connection("out", "gain.y"),
        own=port + bound.get("outer", ""),
    )
    return system(
        within("outer", outer) + component("ten"),
        connection("outer.in", "ten.y") + connection("outer.out", "result"),
        own=connectors(connector("result", "output")) + bound.get("top", ""),
    )


def test_systems_within_systems_are_flown(tmp_path, fmus):
    """Their connectors pass values on and transform them; an element is named after where it is."""
    flown = signals(written(tmp_path, nested(), *fmus.values()))
    assert list(flown) == ["outer_inner_gain.y", "outer_gain.y", "ten.y"]
    assert flown["outer_gain.y"][-1] == 3 * (10 + 1)
    assert flown["outer_gain.y"][1] == 3, "ten is computed after them, and gives 0 before its first step"


@pytest.mark.parametrize(
    ("bound", "k"),
    [
        ({}, 1),
        ({"gain": bindings(parameter("k", "2"))}, 2),
        ({"gain": bindings(parameter("k", "2"), parameter("k", "3"))}, 3),
        ({"gain": bindings(parameter("k", "2")), "inner": bindings(parameter("gain.k", "4"))}, 4),
        ({"inner": bindings(parameter("gain.k", "4")), "outer": bindings(parameter("inner.gain.k", "5"))}, 5),
        ({"outer": bindings(parameter("inner.gain.k", "5")), "top": bindings(parameter("outer.inner.gain.k", "6"))}, 6),
        ({"top": bindings(parameter("k", "7"), attributes='prefix="outer.inner.gain."')}, 7),
        ({"top": bindings(parameter("gain.k", "8"))}, 1),
    ],
)
def test_outer_and_later_bindings_count(tmp_path, fmus, bound, k):
    assert last(written(tmp_path, nested(**bound), *fmus.values()), "outer_inner_gain.y") == k * 33


def bound_gain(inside: str) -> str:
    return system(component("ten") + component("gain", inside=inside), connection("ten.y", "gain.u"))


@pytest.mark.parametrize(
    ("entries", "k"),
    [
        ((entry("a", "k"),), 3),
        ((entry("a", "k", linear(factor=2, offset=0.5)),), 6.5),
        ((entry("b", "k"),), 1),
        ((), 1),
    ],
)
def test_parameters_are_mapped(tmp_path, fmus, entries, k):
    """What a mapping does not name falls away: k itself is in the set too."""
    inside = bindings(parameter("a", "3") + parameter("k", "9"), mapping=mapping(*entries))
    assert last(written(tmp_path, bound_gain(inside), *fmus.values()), "gain.y") == 10 * k


def test_sets_and_mappings_are_documents_of_their_own(tmp_path, fmus):
    inside = """<ssd:ParameterBindings><ssd:ParameterBinding source="values.ssv">
      <ssd:ParameterMapping source="names.ssm"/></ssd:ParameterBinding></ssd:ParameterBindings>"""
    path = written(
        tmp_path,
        bound_gain(inside),
        *fmus.values(),
        values_ssv=f'<ssv:ParameterSet version="1.0" name="p" <NAMES>><ssv:Parameters>{parameter("a", "3")}'
        "</ssv:Parameters></ssv:ParameterSet>",
        names_ssm=f'<ssm:ParameterMapping version="1.0" <NAMES>>{entry("a", "k", linear(factor=-1))}'
        "</ssm:ParameterMapping>",
    )
    assert last(path, "gain.y") == -30


def test_sources_are_uris(tmp_path, fmus):
    plain = written(tmp_path, bound_gain("").replace("gain.fmu", "my%20gain.fmu"), fmus["ten"])
    with zipfile.ZipFile(plain, "a") as archive:
        archive.write(fmus["gain"], "resources/my gain.fmu")
    assert last(plain, "gain.y") == 10


def test_values_reach_parameters_through_connectors_of_systems(tmp_path, fmus):
    inner = system(
        component("gain"),
        connection("gain.k", "stiffness", linear(factor=2)) + connection("in", "gain.u"),
        own=connectors(connector("stiffness", "parameter"), connector("in", "input")),
    )
    text = system(
        component("ten") + within("inner", inner),
        connection("ten.y", "inner.in"),
        own=bindings(parameter("inner.stiffness", "3")),
    )
    assert last(written(tmp_path, text, *fmus.values()), "inner_gain.y") == 60


PLAIN = bound_gain("")
INTEGERS = "<ssc:IntegerMappingTransformation/>"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (system(component("ten", fmu="../ten")), "the source 'resources/../ten.fmu' of ten is not in the archive"),
        (system(component("ten", fmu="none")), "the source 'resources/none.fmu' of ten is not in the archive"),
        (
            system(component("ten", attributes='type="application/x-ssp-package"')),
            "ten is a component of the type application/x-ssp-package, which is not supported",
        ),
        (system('<ssd:SignalDictionaryReference name="d" dictionary="e"/>'), "d is a SignalDictionaryReference, which"),
        (system(component("ten", attributes='implementation="ModelExchange"')), "ten is to be used for model exchange"),
        (system(component("ten") + component("ten")), "two elements of one system are named 'ten'"),
        (system(component("a b", fmu="ten") + component("a.b", fmu="ten")), "two elements differ in signs only"),
        (
            bound_gain(bindings(parameter("k", "two"))),
            "the parameter k is 'two', but must be a finite Real",
        ),
        (bound_gain(bindings(parameter("k", "nan"))), "the parameter k is 'nan', but must be a finite Real"),
        (system(component("ten", fmu=1000 * "n")), "n.fmu' of ten is not in the archive"),
        (
            bound_gain(bindings(parameter("k", "2"), attributes='type="text/csv"')),
            "a parameter binding of gain is of the type 'text/csv', supported is application/x-ssp-parameter-set",
        ),
        (
            bound_gain('<ssd:ParameterBindings><ssd:ParameterBinding source="../x.ssv"/></ssd:ParameterBindings>'),
            "'../x.ssv' cannot be read, it is not in the archive",
        ),
        (
            bound_gain(
                '<ssd:ParameterBindings><ssd:ParameterBinding source="x.ssv" sourceBase="component"/>'
                "</ssd:ParameterBindings>"
            ),
            "a parameter binding of gain lies within a component, which is not supported",
        ),
        (
            bound_gain(bindings(parameter("k", "2"), mapping=mapping(entry("k", "k", INTEGERS)))),
            "the mapping of k to k has the IntegerMappingTransformation, which is not supported: use a Linear",
        ),
        (PLAIN.replace('startElement="ten"', 'startElement="tin"'), "a connection names the element tin, which there"),
        (PLAIN.replace('startConnector="y"', 'startConnector="x"'), "there is no connector ten.x"),
        (PLAIN.replace('startElement="ten"', 'startElement="gain"').replace('"u"', '"y"'), "both give a value"),
        (
            system(component("ten") + component("gain"), 2 * connection("ten.y", "gain.u")),
            "gain.u is connected twice, remove one of the two connections",
        ),
        (
            system(component("ten") + component("gain"), connection("ten.y", "gain.u", linear(factor=0))),
            "of the connection from ten.y to gain.u must have finite numbers and no factor of 0",
        ),
        (
            system(component("gain"), connection("in", "gain.u"), own=connectors(connector("in", "input"))),
            "in feeds gain.u, but nothing is outside here: connect it, or leave its connection out",
        ),
        (
            system(
                component("gain"),
                connection("in", "gain.u"),
                own=connectors(connector("in", "input")) + bindings(parameter("in", "4")),
            ),
            "the input gain.u is fed from outside the system with a constant, which is not supported",
        ),
        (
            system(component("ten") + component("gain"), connection("ten.y", "gain.k")),
            "the parameter gain.k is connected to an output, give it a value instead",
        ),
        (
            system(
                within("s", system(
                    component("gain"),
                    connection("gain.u", "out") + connection("in", "out"),
                    own=connectors(connector("out", "output"), connector("in", "input")))),
                connection("s.out", "s.in")),
            "both take a value",
        ),
        (
            system(
                within("s", system(
                    component("gain"),
                    connection("gain.u", "in") + connection("in", "out"),
                    own=connectors(connector("out", "output"), connector("in", "input")))),
                connection("s.out", "s.in")),
            "s.in feeds itself through the connectors of systems",
        ),
        ("".join(f'<ssd:Elements><ssd:System name="s{i}">' for i in range(30))
         + 30 * "</ssd:System></ssd:Elements>", "is more than 20 systems deep"),
    ],
)  # fmt: skip
def test_what_cannot_be_flown_is_refused_in_one_sentence(tmp_path, fmus, text, message):
    path = written(tmp_path, text, fmus["ten"], fmus["gain"])
    with pytest.raises(UserError) as error:
        System(load_scenario(path, step_size_s=STEP))
    assert str(error.value).startswith(str(path))
    assert message in str(error.value)
    assert "\n" not in str(error.value)


BOMB = '<!DOCTYPE x [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
EXTERNAL = '<!DOCTYPE x SYSTEM "file:///etc/passwd">'


def changed(path: Path, old: str, new: str, name: str = STRUCTURE) -> Path:
    with zipfile.ZipFile(path) as archive:
        contents = {entry: archive.read(entry) for entry in archive.namelist()}
    text = contents[name].decode()
    assert old in text
    contents[name] = text.replace(old, new, 1).encode()
    with zipfile.ZipFile(path, "w") as archive:
        for entry_name, content in contents.items():
            archive.writestr(entry_name, content)
    return path


@pytest.mark.parametrize("outside", ["{}", 20 * "../" + ".{}", 20 * "..%2F" + ".{}"])
def test_nothing_outside_the_archive_is_read(tmp_path, fmus, outside):
    """Neither by an absolute path nor by one that leads there."""
    text = system(component("ten")).replace("resources/ten.fmu", outside.format(fmus["ten"]))
    with pytest.raises(UserError, match=r"ten\.fmu' of ten is not in the archive"):
        load_scenario(written(tmp_path, text))


def test_an_fmu_that_cannot_be_used_is_named_as_the_archive_names_it(tmp_path, fmus):
    path = written(tmp_path, PLAIN, fmus["ten"])
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("resources/gain.fmu", "text")
    with pytest.raises(UserError, match=r"other\.ssp: resources/gain\.fmu is not an FMU or is truncated"):
        load_scenario(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("<ssd:SystemStr", BOMB + "<ssd:SystemStr", "'SystemStructure.ssd' cannot be read: it has a DOCTYPE"),
        ("<ssd:SystemStr", EXTERNAL + "<ssd:SystemStr", "'SystemStructure.ssd' cannot be read: it has a DOCTYPE"),
        ('version="1.0" name="other"', 'version="2.0" name="other"', "is SystemStructureDescription of version 2.0"),
        ('stopTime="0.01"', "", "other.ssp: duration_s is missing"),
        ('stopTime="0.01"', 'stopTime="soon"', "stopTime is 'soon', but must be a number"),
        ("</ssd:System>", "", "'SystemStructure.ssd' cannot be read: mismatched tag"),
        ('<?xml version="1.0"?>', '<?xml version="1.0" encoding="none"?>', "'SystemStructure.ssd' cannot be read: "),
    ],
)
def test_a_hostile_or_damaged_document_is_refused_in_one_sentence(tmp_path, fmus, old, new, message):
    path = changed(written(tmp_path, PLAIN, fmus["ten"], fmus["gain"]), old, new)
    with pytest.raises(UserError) as error:
        load_scenario(path)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_without_a_stop_time_the_user_says_how_long(tmp_path, fmus):
    path = changed(written(tmp_path, PLAIN, fmus["ten"], fmus["gain"]), 'stopTime="0.01"', "")
    assert load_scenario(path, ["duration_s=0.02"]).duration_s == 0.02


def test_a_huge_document_is_not_read(tmp_path, fmus, monkeypatch):
    path = written(tmp_path, PLAIN, fmus["ten"], fmus["gain"])
    monkeypatch.setattr(ssp_archive, "LARGEST_DOCUMENT", 100)
    with pytest.raises(UserError, match=r"'SystemStructure\.ssd' has 0 MiB, more than such a document has"):
        load_scenario(path)


def test_no_archive_at_all_is_refused(tmp_path):
    (tmp_path / "text.ssp").write_text("text")
    with pytest.raises(UserError, match="is not an SSP archive"):
        load_scenario(tmp_path / "text.ssp")
    with zipfile.ZipFile(tmp_path / "empty.ssp", "w") as archive:
        archive.writestr("other.txt", "")
    with pytest.raises(UserError, match=r"'SystemStructure\.ssd' cannot be read, it is not in the archive"):
        load_scenario(tmp_path / "empty.ssp")
