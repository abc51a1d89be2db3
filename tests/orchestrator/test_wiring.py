"""Connections give the one right order of computation, and every mistake in them is refused by name."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import pytest

from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.layout import Connection
from rotordx.orchestrator.variables import ACCESS, Element, Variable
from rotordx.orchestrator.wiring import wire

REAL = ACCESS[2]["Real"]


def ports(causality: str, sizes: dict[str, int | None]) -> dict[str, Variable]:
    return {
        name: Variable(name, "Real", REAL, causality, "m", "", size, (Element(0),), None, -math.inf, math.inf, {})
        for name, size in sizes.items()
    }


@dataclass
class Terminals:
    inputs: dict[str, Variable] = field(default_factory=dict)
    outputs: dict[str, Variable] = field(default_factory=dict)
    variables: dict[str, Variable] = field(default_factory=dict)


def component(inputs: dict[str, int | None] | None = None, outputs: dict[str, int | None] | None = None) -> Terminals:
    return Terminals(ports("input", inputs or {}), ports("output", outputs or {}))


def connect(source: str, target: str, previous_step: bool = False) -> Connection:
    return Connection.model_validate({"from": source, "to": target, "previous_step": previous_step})


CHAIN = {
    "last": component({"u": None}, {"y": None}),
    "middle": component({"u": None}, {"y": None}),
    "first": component({"u": None}, {"y": None}),
}


def test_writers_come_before_their_readers_and_after_readers_of_the_previous_step():
    wiring = wire(
        CHAIN, [connect("first.y", "middle.u"), connect("middle.y", "last.u"), connect("last.y", "first.u", True)]
    )
    assert wiring.order == ["first", "middle", "last"]


def test_declaration_decides_where_the_connections_leave_a_choice():
    independent = {name: component(outputs={"y": None}) for name in ("c", "a", "b")}
    assert wire(independent, []).order == ["c", "a", "b"]


def test_a_previous_step_reader_runs_before_its_writer_even_if_declared_later():
    components = {"writer": component(outputs={"y": None}), "reader": component({"u": None})}
    assert wire(components, [connect("writer.y", "reader.u", True)]).order == ["reader", "writer"]
    assert wire(components, [connect("writer.y", "reader.u")]).order == ["writer", "reader"]


def test_a_component_may_read_its_own_previous_output():
    assert wire({"a": component({"u": None}, {"y": None})}, [connect("a.y", "a.u", True)]).order == ["a"]


def test_the_bus_holds_external_signals_first_then_outputs_as_declared():
    components = {
        "a": component({"u": 3, "v": None}, {"x": 2, "y": None}),
        "b": component({"w": 2, "s": None}, {"z": 4}),
    }
    wiring = wire(
        components,
        [
            connect("external.force", "a.u"),
            connect("a.y", "a.v", True),
            connect("a.x", "b.w"),
            connect("b.z[3]", "b.s", True),
        ],
    )
    assert [info.key for info in wiring.signals] == ["external.force", "a.x", "a.y", "b.z"]
    assert wiring.width == 10
    assert wiring.inputs == {"a": [0, 1, 2, 5], "b": [3, 4, 8]}
    assert [info.key for info in wiring.external] == ["external.force"]


@pytest.mark.parametrize(
    ("connections", "message"),
    [
        (
            [connect("first.y", "middle.u"), connect("middle.y", "last.u"), connect("last.y", "first.u")],
            "the components depend on each other in a circle: .*last.y -> first.u.*; set previous_step = true",
        ),
        (
            [connect("first.y", "middle.u"), connect("middle.y", "last.u"), connect("first.y", "first.u")],
            "depend on each other in a circle: first.y -> first.u;",
        ),
        ([connect("first.y", "middle.u"), connect("middle.y", "last.u")], "the input first.u is not connected: add"),
        ([connect("first.y", "first.w", True)], r"connection to 'first.w': there is no such input, .*one of first.u"),
        ([connect("first.y", "fist.u", True)], r"there is no such input, .*\(did you mean first\?\)"),
        (
            [connect("first.x", "last.u", True), connect("last.y", "middle.u"), connect("middle.y", "first.u")],
            "connection from 'first.x': there is no such output, it must be one of first.y",
        ),
        (
            [connect("first.y[2]", "last.u", True), connect("last.y", "middle.u"), connect("middle.y", "first.u")],
            r"connection from 'first.y\[2\]': there is no such output",
        ),
        ([connect("last.y", "first.u")] * 2, "connection to 'first.u': this input is connected twice"),
    ],
)
def test_mistakes_are_refused_by_name(connections, message):
    with pytest.raises(UserError, match=message):
        wire(CHAIN, connections)


def test_what_is_no_number_is_not_connected():
    text = Variable("label", "String", None, "input", "1", "", None, (Element(0),), None, -math.inf, math.inf, {})
    components = {"a": component(outputs={"y": 3}), "b": Terminals(variables={"label": text})}
    with pytest.raises(UserError, match=r"^connection to 'b.label': this is a String, only numbers are connected$"):
        wire(components, [connect("a.y", "b.label")])


def test_sizes_must_agree():
    components = {"a": component(outputs={"y": 3}), "b": component({"u": 4})}
    with pytest.raises(UserError, match=r"'a.y' to 'b.u': the output has 3 elements and the input 4"):
        wire(components, [connect("a.y", "b.u")])
