"""Decimation for drawing: fewer points than samples, and no peak lost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def bucket_starts(count: int, points: int, focus: tuple[int, int] | None = None) -> NDArray[np.intp]:
    """Divide `count` samples into buckets of which each is drawn as two points.

    Two thirds of the points go to the samples of `focus` (start, stop), which are the ones a reader zooms into; a
    bucket of two samples loses nothing. The first and the last bucket hold one sample, so that both ends are kept.

    Returns:
        index of the first sample of each bucket, strictly increasing from 0; about `points` / 2 of them.
    """
    if count <= 2:
        return np.arange(count)
    start, stop = (0, 0) if focus is None else (min(max(i, 1), count - 1) for i in focus)
    outside = points if start >= stop else points // 3
    size_outside = max(2, -(-2 * (count - max(stop - start, 0)) // outside))
    size_inside = max(2, -(-2 * (stop - start) // max(points - outside, 1)))
    return np.unique(
        np.concatenate(
            [
                [0],
                np.arange(1, start, size_outside),
                np.arange(start, stop, size_inside),
                np.arange(max(stop, start, 1), count - 1, size_outside),
                [count - 1],
            ]
        )
    ).astype(np.intp)


def bucket_times(time: NDArray[np.float64], starts: NDArray[np.intp]) -> NDArray[np.float64]:
    """Times of the two points of each bucket: (2 * buckets,), those of its first and of its last sample."""
    last = np.append(starts[1:], len(time)) - 1
    return np.column_stack([time[starts], time[last]]).ravel()


def envelope(values: NDArray[np.floating], starts: NDArray[np.intp]) -> NDArray[np.float32]:
    """Smallest and largest sample of each bucket, in the order in which they occur.

    Args:
        values: (N,) or (N, signals); NaN samples are left out, a bucket without any other is NaN.
        starts: of the buckets, from `bucket_starts`.

    Returns:
        (2 * buckets,) or (2 * buckets, signals): what to draw at `bucket_times`.
    """
    values = np.asarray(values, dtype=np.float32)
    lowest, highest = np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)
    sizes = np.diff(np.append(starts, len(values)))
    index = np.arange(len(values)).reshape((-1,) + (1,) * (values.ndim - 1))

    def first_occurrence(extreme: NDArray[np.float32]) -> NDArray[np.intp]:
        return np.minimum.reduceat(np.where(values == np.repeat(extreme, sizes, axis=0), index, len(values)), starts)

    rising = first_occurrence(lowest) <= first_occurrence(highest)
    pairs = np.stack([np.where(rising, lowest, highest), np.where(rising, highest, lowest)], axis=1)
    return pairs.reshape((-1, *values.shape[1:]))
