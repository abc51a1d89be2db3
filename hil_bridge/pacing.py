"""Real time: waiting for instants of an absolute clock, and the best that the machine allows for that."""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from ctypes import CDLL

FIFO_PRIORITY = 50
_MCL_CURRENT_AND_FUTURE = 3


def wait_until(instant: float, spin_margin: float) -> float:
    """Sleep, then spin for the last `spin_margin` (s), until an instant of `time.monotonic`; how late it is then, s."""
    while (left := instant - time.monotonic()) > spin_margin:
        time.sleep(left - spin_margin)
    while (now := time.monotonic()) < instant:
        pass
    return now - instant


@contextmanager
def undisturbed(*, fifo: bool) -> Iterator[dict[str, bool]]:
    """No garbage collection, and if asked for SCHED_FIFO and locked memory; gives what the machine granted."""
    granted = {"sched_fifo": fifo and _fifo(True), "memory_locked": fifo and _lock_memory(True)}
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield granted
    finally:
        gc.enable()
        gc.unfreeze()
        if granted["memory_locked"]:
            _lock_memory(False)
        if granted["sched_fifo"]:
            _fifo(False)


def _fifo(on: bool) -> bool:
    policy, priority = (os.SCHED_FIFO, FIFO_PRIORITY) if on else (os.SCHED_OTHER, 0)
    try:
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except OSError:
        return False
    return True


def _lock_memory(on: bool) -> bool:
    library = CDLL(None)
    return (library.mlockall(_MCL_CURRENT_AND_FUTURE) if on else library.munlockall()) == 0
