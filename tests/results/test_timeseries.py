"""timeseries.parquet holds every signal exactly, with its unit, in plain columns, and the same bytes each time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pyarrow import parquet

from rotordx.orchestrator import metrics, results
from rotordx.orchestrator.errors import UserError
from tests.report.synthetic import circle_flight
from tests.results.hand_made import recording


def with_odd_signals():
    """A recording with every shape a port can have, and every kind of number."""
    flown = recording()
    odd = {
        "a.scalar": np.linspace(-1, 1, 101),
        "a.one_element": np.geomspace(1e-300, 1e300, 101)[:, np.newaxis],
        "a.vector": np.random.default_rng(0).normal(size=(101, 3)),
        "a.strided": np.random.default_rng(1).normal(size=(202, 4))[::2, ::2],
    }
    odd["a.vector"][3] = np.nan, np.inf, -0.0
    about = {key: f"unit of {key}" for key in odd}
    return replace(
        flown,
        signals=flown.signals | odd,
        units=flown.units | about,
        descriptions=flown.descriptions | {key: f"what {key} is" for key in odd},
    )


def test_reading_gives_back_what_was_written(tmp_path):
    flown = with_odd_signals()
    summary = metrics.summarise(flown)
    results.write(flown, summary, tmp_path / "result")
    again, summary_again = results.read(tmp_path / "result")
    assert summary_again == summary
    assert list(again.signals) == list(flown.signals)
    for key, values in flown.signals.items():
        assert again.signals[key].shape == values.shape, key
        assert again.signals[key].tobytes() == np.ascontiguousarray(values).tobytes(), key
    assert again.time.tobytes() == flown.time.tobytes()
    same = ("units", "descriptions", "scenario", "faults", "diagnosers")
    assert [getattr(again, name) for name in same] == [getattr(flown, name) for name in same]
    assert metrics.summarise(again) == summary


def test_columns_are_plain_float64_with_unit_and_description(tmp_path):
    flown = with_odd_signals()
    results.write_timeseries(flown, tmp_path / "t.parquet")
    schema = parquet.read_schema(tmp_path / "t.parquet")
    assert schema.names[0] == "time"
    assert {"a.scalar", "a.one_element[1]", "a.vector[1]", "a.vector[3]", "d.fault_detected"} <= set(schema.names)
    assert {str(field.type) for field in schema} == {"double"}
    about = schema.field("a.vector[2]").metadata
    assert about[b"unit"] == b"unit of a.vector"
    assert about[b"description"] == b"what a.vector is"
    assert schema.field("time").metadata[b"unit"] == b"s"


def test_numbers_are_stored_as_byte_streams(tmp_path):
    results.write_timeseries(recording(), tmp_path / "t.parquet")
    group = parquet.ParquetFile(tmp_path / "t.parquet").metadata.row_group(0)
    for i in range(group.num_columns):
        assert "BYTE_STREAM_SPLIT" in group.column(i).encodings
        assert not group.column(i).has_dictionary_page


def test_the_same_flight_gives_the_same_bytes(tmp_path):
    for name, wall_time in (("first", 0.5), ("second", 99.0)):
        flown = circle_flight(duration=2.0)
        flown.measurements.update(wall_time_s=wall_time, messages={"d": [name]})
        results.write_timeseries(flown, tmp_path / f"{name}.parquet")
    assert (tmp_path / "first.parquet").read_bytes() == (tmp_path / "second.parquet").read_bytes()


def test_another_flight_gives_other_bytes(tmp_path):
    for seed in (1, 2):
        results.write_timeseries(circle_flight(duration=2.0, seed=seed), tmp_path / f"{seed}.parquet")
    assert (tmp_path / "1.parquet").read_bytes() != (tmp_path / "2.parquet").read_bytes()


@pytest.mark.parametrize("damage", ["missing", "truncated", "foreign", "not JSON"])
def test_what_is_no_result_is_refused_by_name(tmp_path, damage):
    flown = recording()
    folder = tmp_path / "result"
    results.write(flown, metrics.summarise(flown), folder)
    log = folder / "timeseries.parquet"
    if damage == "missing":
        log.unlink()
    elif damage == "truncated":
        log.write_bytes(log.read_bytes()[:1000])
    elif damage == "foreign":
        parquet.write_table(parquet.read_table(log).replace_schema_metadata(None), log)
    else:
        (folder / "summary.json").write_text("{")
    with pytest.raises(UserError, match=f"{folder} does not hold a complete result"):
        results.read(folder)
