"""The gain of the Thau observer (Nguyen, Hong 2018, Lemma 1), which `adaptive_thau` and `asmto` have as well.

The injection is - K (y_hat - y), as (16) has it: (8) and (13) print a plus, with which the observer diverges.
"""

from __future__ import annotations

from rotordx.fmus.shell.ports import Vector, port, ports

#: Lemma 1 for epsilon = 100 1/s, up to 0.01
K_OF_THE_PAPER = tuple(100.0 if i == j else 1.0 if abs(i - j) == 3 else 0.0 for i in range(6) for j in range(6))


@ports
class ObserverParameters:
    """Gain of Lemma 1 (gains/thau.py)."""

    observer_gain: Vector = port("1/s", "K of (8), 6x6 by rows: roll, pitch, yaw, p, q, r", start=K_OF_THE_PAPER)
