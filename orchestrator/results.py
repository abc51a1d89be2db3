"""Result folders: summary.json, timeseries.parquet and report.html, written whole or not at all."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from rotordx.orchestrator import folders, report
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.folders import whole_folder
from rotordx.orchestrator.recording import Recording

SUMMARY, TIMESERIES, REPORT = "summary.json", "timeseries.parquet", "report.html"
FILES = (SUMMARY, TIMESERIES, REPORT)
_ORIGIN = b"rotordx"  #: key of the Parquet metadata that holds what the signals came from, as JSON


def write(recording: Recording, summary: dict[str, Any], folder: str | Path) -> None:
    """Write a result folder, whole or not at all; an earlier result in its place is replaced.

    Raises:
        UserError: the folder cannot be written, or holds something else than a result.
    """
    with whole_folder(folder, FILES) as partial:
        write_timeseries(recording, partial / TIMESERIES)
        (partial / SUMMARY).write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        (partial / REPORT).write_text(report.html(recording, summary), encoding="utf-8")


def check_folder(folder: str | Path) -> None:
    """Find out before a long run whether its result could not be put there.

    Raises:
        UserError: something that is not a result is in the place of the folder.
    """
    folders.check_folder(folder, FILES)


def read(folder: str | Path) -> tuple[Recording, dict[str, Any]]:
    """Recording and summary of a result folder; of the measurements, those that the summary holds.

    Raises:
        UserError: the folder does not hold a result.
    """
    folder = Path(folder)
    try:
        summary = json.loads((folder / SUMMARY).read_text(encoding="utf-8"))
        recording = read_timeseries(folder / TIMESERIES)
    except (OSError, ValueError) as error:
        raise UserError(f"{folder} does not hold a complete result ({error}). Name the folder of a run.") from error
    recording.measurements.update(
        wall_time_s=summary["wall_time_s"],
        real_time_factor=summary["real_time_factor"],
        step_time_ns={name: score["step_time_ns"] for name, score in summary["diagnosers"].items()},
    )
    return recording, summary


def write_timeseries(recording: Recording, path: Path) -> None:
    """All signals as float64 columns `time`, `component.port`, `component.port[1]`, ... of one Parquet file.

    Each field's metadata has `unit` and `description`. The bytes depend on the recording alone. Byte-stream split
    with Zstandard halves a log of 120 signals and takes no longer than writing it uncompressed.
    """
    import pyarrow as pa
    from pyarrow import parquet

    arrays = [pa.array(recording.time)]
    fields = [pa.field("time", pa.float64(), metadata={"unit": "s", "description": "time of the sample"})]
    for key, values in recording.signals.items():
        about = {"unit": recording.units.get(key, ""), "description": recording.descriptions.get(key, "")}
        for name, column in _columns(key, values):
            arrays.append(pa.array(np.ascontiguousarray(column)))
            fields.append(pa.field(name, pa.float64(), metadata=about))
    origin = {"scenario": recording.scenario, "faults": recording.faults, "diagnosers": recording.diagnosers}
    schema = pa.schema(fields, metadata={_ORIGIN: json.dumps(origin)})
    parquet.write_table(
        pa.Table.from_arrays(arrays, schema=schema),
        path,
        use_dictionary=False,
        use_byte_stream_split=True,
        compression="zstd",
    )


def read_timeseries(path: Path) -> Recording:
    """Recording of a file from `write_timeseries`, without measurements.

    Raises:
        ValueError: not such a file.
    """
    from pyarrow import parquet

    table = parquet.read_table(path)
    origin = (table.schema.metadata or {}).get(_ORIGIN)
    if origin is None:
        raise ValueError(f"{path.name} was not written by rotordx")
    columns: dict[str, list[np.ndarray]] = {}
    units, descriptions = {}, {}
    arrays = set()
    for field, column in zip(table.schema, table.columns, strict=True):
        key, bracket, _ = field.name.partition("[")
        columns.setdefault(key, []).append(column.to_numpy())
        units[key], descriptions[key] = (field.metadata[about].decode() for about in (b"unit", b"description"))
        if bracket:
            arrays.add(key)
    signals = {key: np.column_stack(parts) if key in arrays else parts[0] for key, parts in columns.items()}
    time = signals.pop("time")
    del units["time"], descriptions["time"]
    return Recording(time=time, signals=signals, units=units, descriptions=descriptions, **json.loads(origin))


def _columns(key: str, values: np.ndarray) -> list[tuple[str, np.ndarray]]:
    if values.ndim == 1:
        return [(key, values)]
    return [(f"{key}[{i + 1}]", column) for i, column in enumerate(values.T)]
