"""Decimation for drawing loses no peak: extremes, ends and order of the samples survive."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rotordx.orchestrator.report.columns import Columns
from rotordx.orchestrator.report.decimation import bucket_starts, bucket_times, envelope

VALUES = st.floats(-1e6, 1e6, width=32)


@st.composite
def signals(draw, elements=VALUES):
    """(values, starts of their buckets), with or without a focus."""
    count = draw(st.integers(1, 400))
    focus = draw(st.none() | st.tuples(st.integers(0, 400), st.integers(0, 400)))
    return draw(arrays(np.float32, count, elements=elements)), bucket_starts(count, draw(st.integers(4, 900)), focus)


@given(signals())
def test_every_bucket_keeps_its_extremes_and_the_ends_survive(signal):
    values, starts = signal
    drawn = envelope(values, starts).reshape(-1, 2)
    for bucket, pair in zip(np.split(values, starts[1:]), drawn, strict=True):
        assert sorted(pair) == [bucket.min(), bucket.max()]
    assert (drawn[0, 0], drawn[-1, -1]) == (values[0], values[-1])


@given(signals())
def test_the_extremes_of_a_bucket_keep_their_order(signal):
    values, starts = signal
    for bucket, (first, last) in zip(
        np.split(values, starts[1:]), envelope(values, starts).reshape(-1, 2), strict=True
    ):
        assert np.argmax(bucket == first) <= len(bucket) - 1 - np.argmax(bucket[::-1] == last)


@given(signals(elements=VALUES | st.just(np.nan)))
def test_missing_samples_hide_no_others(signal):
    values, starts = signal
    for bucket, pair in zip(np.split(values, starts[1:]), envelope(values, starts).reshape(-1, 2), strict=True):
        known = bucket[~np.isnan(bucket)]
        assert np.isnan(pair).all() if not known.size else sorted(pair) == [known.min(), known.max()]


@given(signals())
def test_signals_side_by_side_are_decimated_as_if_alone(signal):
    values, starts = signal
    together = envelope(np.column_stack([values, -values[::-1]]), starts)
    np.testing.assert_array_equal(together[:, 0], envelope(values, starts))
    np.testing.assert_array_equal(together[:, 1], envelope(-values[::-1], starts))


@given(signals())
def test_times_never_run_back_and_lie_in_their_bucket(signal):
    values, starts = signal
    time = np.arange(len(values)) * 0.5
    drawn = bucket_times(time, starts)
    assert (np.diff(drawn) >= 0).all()
    np.testing.assert_array_equal(drawn.reshape(-1, 2)[:, 0], time[starts])
    assert drawn[-1] == time[-1]


@given(st.integers(3, 50_000), st.integers(8, 3000), st.integers(0, 50_000), st.integers(0, 5000))
def test_points_stay_within_the_budget(count, points, start, length):
    starts = bucket_starts(count, points, (start, start + length))
    assert starts[0] == 0
    assert (np.diff(starts) > 0).all()
    assert 2 * len(starts) <= points + 10  # both ends, and a bucket that is not full before and after the focus


def test_the_focus_is_drawn_sample_by_sample():
    values = np.random.default_rng(0).normal(size=30_001)
    starts = bucket_starts(len(values), 2600, (12_000, 13_000))
    drawn, times = envelope(values, starts), bucket_times(np.arange(len(values), dtype=float), starts)
    inside = (times >= 12_000) & (times < 13_000)
    np.testing.assert_array_equal(times[inside], np.arange(12_000, 13_000))
    np.testing.assert_array_equal(drawn[inside], values[12_000:13_000].astype(np.float32))


def test_columns_share_one_budget():
    time = np.arange(30_001) * 0.002
    sizes = []
    for count in (50, 500):
        columns = Columns(time)
        clock = columns.clock("time", (24.0, 26.0))
        for i in range(count):
            columns.add(clock, str(i), np.sin(time + i))
        sizes.append(sum(len(column["base64"]) for column in columns.encode().values()))
    assert sizes[1] < 0.7e6
    assert sizes[1] < 3 * sizes[0]  # for ten times the columns
