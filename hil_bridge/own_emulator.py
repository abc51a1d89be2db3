"""The emulator that a bridge starts for itself: a process, or a thread where no process could reach the bus."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import get_context

from rotordx.hil_bridge.buses import BusAddress
from rotordx.hil_bridge.emulator import EscSettings, emulated
from rotordx.hil_bridge.pacing import undisturbed
from rotordx.orchestrator.scenario import Scenario

END_TIMEOUT = 2.0  #: s


@contextmanager
def own_emulator(bus: BusAddress, scenario: Scenario, settings: EscSettings, *, fifo: bool) -> Iterator[None]:
    """An emulator beside this thread of the program, until the end of the `with` statement.

    Raises:
        BusError: there is no such bus (thread; a process says so on stderr, and no ESC will answer).
    """
    if bus.is_in_process:
        ended = threading.Event()
        with emulated(bus, scenario, settings) as emulator:
            thread = threading.Thread(target=emulator.run, args=(ended.is_set,), daemon=True)
            thread.start()
            try:
                yield
            finally:
                ended.set()
                thread.join()
        return
    process = get_context("spawn").Process(
        target=_serve, args=(bus, scenario, settings, fifo, os.getpid()), name="rotordx esc", daemon=True
    )
    process.start()
    try:
        yield
    finally:
        process.terminate()
        process.join(END_TIMEOUT)
        process.close()


def _serve(bus: BusAddress, scenario: Scenario, settings: EscSettings, fifo: bool, parent: int) -> None:
    """Emulate as long as the parent lives; Ctrl-C is its to handle."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with emulated(bus, scenario, settings) as emulator, undisturbed(fifo=fifo):
        emulator.run(lambda: os.getppid() != parent)
