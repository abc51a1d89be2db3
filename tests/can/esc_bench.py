"""A hand-driven flight controller for an ESC emulator that waits for each step it is asked for."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

import numpy as np

from rotordx.hil_bridge.buses import BusAddress, open_bus
from rotordx.hil_bridge.emulator import EscSettings, emulated
from rotordx.hil_bridge.link import Link, Received
from rotordx.hil_bridge.messages import (
    ArmingStatus,
    Message,
    NodeStatus,
    RawCommand,
    RotorSpeeds,
    SpeedsRequest,
    Status,
    StatusExtended,
    StepDone,
    StepRequest,
)
from rotordx.hil_bridge.protocol import from_counts, to_counts
from rotordx.orchestrator.scenario import load_scenario

LARGEST = 950.0  #: rad/s, of lab_x
STEP = 0.002
ESCS = {11, 12, 13, 14}
M = TypeVar("M", bound=Message)
_channels = itertools.count()


class Bench:
    """A controller in lock step with an emulator; `heard` is what came in the last step."""

    def __init__(self, link: Link):
        self.link = link
        self.heard: list[Received] = []
        self.number = 0
        self.request(0)

    def request(self, number: int) -> None:
        self.link.send(10, StepRequest(number))
        self.heard = []
        while True:
            received = self.link.receive(10.0)
            assert received is not None, "the emulator does not answer"
            if isinstance(received.message, StepDone):
                assert received.message.number == number
                return
            self.heard.append(received)

    def step(self, *messages: Message, node: int = 10) -> np.ndarray:
        """Send messages, have a step made; the rotor speeds (rad/s) that it gave."""
        for message in messages:
            self.link.send(node, message)
            if message == ARM:
                self.link.send(node, SpeedsRequest())
        self.number += 1
        self.request(self.number)
        speeds = self.all(RotorSpeeds)
        return from_counts(speeds[-1].counts, LARGEST) if speeds else np.full(4, np.nan)

    def all(self, kind: type[M]) -> list[M]:
        return [received.message for received in self.heard if isinstance(received.message, kind)]


def command(*speed: float) -> RawCommand:
    return RawCommand(tuple(to_counts(speed if len(speed) > 1 else speed * 4, LARGEST)))


ARM, DISARM = ArmingStatus(ArmingStatus.FULLY_ARMED), ArmingStatus(ArmingStatus.DISARMED)


@contextmanager
def bench(*overrides: str, scenario: str = "hover", **settings) -> Iterator[Bench]:
    address = BusAddress.of(f"virtual:bench {next(_channels)}")
    ended = threading.Event()
    kinds = (Status, StatusExtended, NodeStatus)
    expected: dict[type[Message], set[int]] = {**dict.fromkeys(kinds, ESCS), RotorSpeeds: {11}, StepDone: {11}}
    flown = load_scenario(scenario, overrides)
    with emulated(address, flown, EscSettings(**settings)) as emulator:
        thread = threading.Thread(target=emulator.run, args=(ended.is_set,))
        thread.start()
        link = Link(open_bus(address), {10: "controller", 20: "stranger"}, expected)
        try:
            yield Bench(link)
        finally:
            ended.set()
            thread.join()
            link.close()
