"""Port declarations are checked, and everything made from them says the same."""

from __future__ import annotations

from math import nan

import pytest

from rotordx.fmus import load_component
from rotordx.fmus.shell import header, model_description
from rotordx.fmus.shell.ports import Component, Port, port, ports, unflatten
from rotordx.fmus.shell.readme import port_table, updated


@ports
class NoPorts:
    pass


@ports
class Outputs:
    level: float = port("m", "a level")


def component(**declarations) -> Component:
    parameters = ports(type("Parameters", (), {"__annotations__": dict.fromkeys(declarations), **declarations}))
    return Component("example", "An example", NoPorts, Outputs, (parameters,))


@pytest.mark.parametrize(
    ("declaration", "message"),
    [
        ({"gain": port("1", "twice", nan)}, "gain starts at nan, which is not finite"),
        ({"gain": port("1", "low", -1.0, minimum=0)}, "gain starts at -1.0, outside its range"),
        ({"gain": port("1", "high", (1.0, 3.0), maximum=2)}, "gain starts at 3.0, outside its range"),
        ({"time": port("s", "now")}, "time has the name of FMI's independent variable"),
        ({"level": port("m", "again")}, "level is declared twice"),
        ({"step_size": port("s", "again")}, "step_size is declared twice"),
        ({"kind": port("1", "kind", 2, choices=("a", "b"))}, "kind starts at 2.0, which is none of its 2 choices"),
        (
            {"kind": port("1", "kind", (0, 0), choices=("a", "b"))},
            "kind has choices, which only a scalar parameter may have",
        ),
    ],
)
def test_impossible_declarations_are_refused_by_name(declaration, message):
    with pytest.raises(ValueError, match=f"component example: port {message}"):
        component(**declaration)


@pytest.mark.parametrize(
    ("unit", "exponents"),
    [
        ("1", {}),
        ("m/s2", {"m": 1, "s": -2}),
        ("rad/s", {"rad": 1, "s": -1}),
        ("N.m.s2", {"kg": 1, "m": 2}),
        ("kg.m2", {"kg": 1, "m": 2}),
        ("1/s3", {"s": -3}),
        ("N.s/m", {"kg": 1, "s": -1}),
        ("m/s2, rad/s2", None),
    ],
)
def test_units_are_products_of_base_units(unit, exponents):
    assert model_description.base_unit(unit) == exponents


@pytest.mark.parametrize("unit", ["furlong", "m/s/s", "m^2", "deg", "m, furlong"])
def test_unknown_units_are_refused(unit):
    with pytest.raises(ValueError, match="is not a product of powers"):
        model_description.base_unit(unit)


def test_token_changes_with_every_declaration():
    variants = [
        component(gain=port("1", "gain", 1.0)),
        component(gain=port("1", "gain", 2.0)),
        component(gain=port("1", "gain", (1.0,))),
        component(gain=port("1", "gain", 1.0, minimum=0)),
        component(gain=port("1/s", "gain", 1.0)),
        component(other=port("1", "gain", 1.0)),
    ]
    tokens = [model_description.token(variant, "1") for variant in variants]
    assert len(set(tokens)) == len(tokens)
    assert model_description.token(variants[0], "2") != tokens[0]
    assert model_description.token(component(gain=port("1", "gain", 1.0)), "1") == tokens[0]


def test_header_gives_each_port_its_offset():
    text = header.ports_header(load_component("esc"), accessors=True)
    offsets = {p.name: (offset, p) for offset, _, p in load_component("esc").variables()}
    offset, p = offsets["fault_rotor"]
    assert p.size == 8
    assert f"fault_rotor() {{ return Eigen::Map<Eigen::Matrix<double, 8, 1>>(value + {offset}); }}" in text
    offset, _ = offsets["mass"]
    assert f"double& mass() {{ return value[{offset}]; }}" in text
    assert f"const double* vehicle_parameters() const {{ return value + {offset}; }}" in text


def test_values_go_back_to_ports():
    outputs = unflatten(Outputs, [4.0])
    assert outputs.level == 4.0


def test_port_table_replaces_only_its_block():
    example = component(gain=port("1/s", "a|b", (5, 8), minimum=0))
    text = "# Title\n\n<!-- ports -->\nold\n<!-- /ports -->\n\nrest\n"
    new = updated(text, example)
    assert new.startswith("# Title\n\n<!-- ports -->\n")
    assert new.endswith("<!-- /ports -->\n\nrest\n")
    assert "old" not in new
    assert "| `gain[2]` | 1/s | 5, 8 | ≥ 0 | a\\|b |" in port_table(example)
    assert updated(new, example) == new


@pytest.mark.parametrize("text", ["# no markers\n", "<!-- ports -->\n", "<!-- /ports -->\n<!-- ports -->\n"])
def test_readme_without_markers_is_refused(text):
    with pytest.raises(ValueError, match="README of example"):
        updated(text, component(gain=port("1", "gain")))


def test_unknown_components_are_refused_by_name():
    with pytest.raises(LookupError, match=r"there is no component 'nothing'; known are .*esc"):
        load_component("nothing")


def test_element_names_follow_fmi():
    assert Port("a", "1", "", (0.0, 0.0), 2).element_names() == ["a[1]", "a[2]"]
    assert Port("a", "1", "", (0.0,), 1).element_names() == ["a[1]"]
    assert Port("a", "1", "", (0.0,), None).element_names() == ["a"]
