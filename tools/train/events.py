"""Network inputs from raw events, in numpy: histograms and keypoints.

Times are int64 microseconds and every comparison is between exact integers or correctly rounded
float64 quotients, so that an event on an edge always falls on the same side.
"""
import numpy as np

from model import RELEASE_INTERVALS, pivots


def exposure_slice(t, start, end):
    """Slice of the (sorted, int64 microseconds) events of the exposure, both ends included."""
    return slice(np.searchsorted(t, start, "left"), np.searchsorted(t, end, "right"))


def normalise(t, start, end):
    """Normalised time 2 (t - start) / (end - start) - 1, float64, rounded once."""
    span = int(end) - int(start)
    return (2 * (np.asarray(t, np.int64) - int(start)) - span) / float(span)


def unet_edges(variant, bins, span=1.0):
    """Edges of the U-Net's histogram, normalised float64: bins/2 equal intervals.

    `paper`: of the whole exposure. `release`: linspace(-span, span, 14).
    """
    if variant == "release":
        return np.linspace(-span, span, RELEASE_INTERVALS + 1)
    return pivots(bins // 2 + 1)


def _accumulate(counts, channel, x, y):
    _, height, width = counts.shape
    index = (channel * height + y) * width + x
    counts += np.bincount(index, minlength=counts.size).reshape(counts.shape)


def histogram(tau, x, y, p, edges, size, variant):
    """Counts, int64 [2 (len(edges) - 1), H, W]: channel 2i positive, 2i + 1 negative of interval i.

    tau: normalised float64 times, ascending; edges ascending; size = (H, W).
    `paper`: intervals [e_i, e_i+1), the last one closed. `release`: intervals closed at both ends,
    each without every event at its own latest time.
    """
    edges = np.asarray(edges, np.float64)
    count = len(edges) - 1
    counts = np.zeros((2 * max(count, 0),) + tuple(size), np.int64)
    x, y = np.asarray(x, np.int64), np.asarray(y, np.int64)
    negative = (np.asarray(p) <= 0).astype(np.int64)
    for i in range(count):
        first = np.searchsorted(tau, edges[i], "left")
        closed = variant == "release" or i == count - 1
        last = np.searchsorted(tau, edges[i + 1], "right" if closed else "left")
        if variant == "release" and last > first:
            last = np.searchsorted(tau, tau[last - 1], "left")
        if last > first:
            part = slice(first, last)
            _accumulate(counts, 2 * i + negative[part], x[part], y[part])
    return counts


def keypoints(t, x, y, start, end, n, size, variant):
    """Keypoints, float32 [n, H, W] (figure 2a): each pivot moves to its nearest event in its cell.

    t: int64 microseconds, sorted, inside [start, end]. A border between cells belongs to the later
    cell, a tie keeps the earlier event, a cell without events keeps the pivot. `release` keeps the
    published defect: time runs from 0 (first event) to 1 (last), pivots from -1 to 1.
    """
    height, width = size
    result = np.broadcast_to(pivots(n).astype(np.float32)[:, None, None], (n, height, width)).copy()
    t = np.asarray(t, np.int64)
    if variant == "release":
        origin, span = (int(t[0]), int(t[-1] - t[0])) if len(t) else (0, 0)
        numerator = t - origin              # time = numerator / span
    else:
        span = int(end) - int(start)
        numerator = 2 * (t - int(start)) - span
    if len(t) == 0 or span <= 0:
        return result
    # The distance from pivot (2i - (n-1)) / (n-1), times span (n-1), is an integer: ties are exact.
    scaled = numerator * (n - 1)
    cell = np.clip((scaled + n * span) // (2 * span), 0, n - 1)
    distance = np.abs(scaled - (2 * cell - (n - 1)) * span)
    slot = (cell * height + np.asarray(y, np.int64)) * width + np.asarray(x, np.int64)
    order = np.lexsort((np.arange(len(t)), distance, slot))
    slot = slot[order]
    keep = np.ones(len(slot), bool)
    keep[1:] = slot[1:] != slot[:-1]
    result.reshape(-1)[slot[keep]] = (numerator[order][keep] / float(span)).astype(np.float32)
    return result


def network_inputs(t, x, y, p, start, end, size, variant, bins, n, times, span=1.0):
    """Histogram, keypoints and interval histogram of one exposure, as float32 arrays.

    times: ascending normalised frame times; events outside the exposure are ignored.
    """
    part = exposure_slice(t, start, end)
    t, x, y, p = t[part], x[part], y[part], p[part]
    tau = normalise(t, start, end)
    counts = histogram(tau, x, y, p, unet_edges(variant, bins, span), size, variant)
    between = histogram(tau, x, y, p, times, size, variant)
    points = keypoints(t, x, y, start, end, n, size, variant)
    return counts.astype(np.float32), points, between.astype(np.float32)
