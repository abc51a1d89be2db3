"""Ctrl-C that cannot get lost.

Python raises KeyboardInterrupt wherever it happens to be. In a function that C calls (an FMU's logger, a finaliser)
the exception is printed and dropped, and the program goes on. So the signal is remembered too, and long loops look.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_signalled = False


@contextmanager
def remembered() -> Iterator[None]:
    """Remember a Ctrl-C within this context, besides raising KeyboardInterrupt.

    Other threads than the main one never see a signal: there is nothing to remember.
    """
    global _signalled
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        global _signalled
        _signalled = True
        raise KeyboardInterrupt

    _signalled = False
    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
        _signalled = False


def check() -> None:
    """Raise the KeyboardInterrupt that got lost, if one did."""
    if _signalled:
        raise KeyboardInterrupt
