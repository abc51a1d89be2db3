"""What happened to a flight and when a diagnoser noticed: the instants that the figures mark."""

from __future__ import annotations

from dataclasses import dataclass

from rotordx.orchestrator import metrics
from rotordx.orchestrator.recording import Recording

Period = tuple[float, float]  #: s

BEFORE, AFTER = 0.5, 2.0  #: s of a closer look before the first event and after the detection
LATE = 5.0  #: s between two events that no closer look shows both


@dataclass(frozen=True)
class Mark:
    """A vertical line in a figure."""

    time: float  #: s
    label: str
    colour: str


@dataclass(frozen=True)
class Events:
    """Times in s, None for what did not happen; `window` is the part of the whole `period` worth a closer look."""

    period: Period
    window: Period | None
    onset: float | None
    detection: float | None
    isolation: float | None

    def marks(self) -> list[Mark]:
        """Marks of the events that happened, in the order of their times."""
        named = (
            (self.onset, "fault", "@ink"),
            (self.detection, "detected", "@orange"),
            (self.isolation, "isolated", "@purple"),
        )
        marks = [Mark(time, label, colour) for time, label, colour in named if time is not None]
        return sorted(marks, key=lambda mark: mark.time)


def events(recording: Recording, detection: float | None = None, isolation: float | None = None) -> Events:
    """Events of a recording in which a diagnoser detected and isolated at these times (s)."""
    start, end = float(recording.time[0]), float(recording.time[-1])
    onset = metrics.first_onset(recording)
    main = onset if detection is None else detection
    window = None
    if main is not None and main > start:
        first = onset if onset is not None and 0 <= main - onset < LATE else main
        last = isolation + BEFORE if isolation is not None and 0 <= isolation - main < LATE else main
        window = (max(start, first - BEFORE), min(end, max(main + AFTER, last)))
    return Events((start, end), window, onset, detection, isolation)
