"""Spans of failures at random: exponential times between failures and to repair."""

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.random_streams.philox import Stream, uniforms_of

#: Failures that are drawn at a time.
_BATCH = 64


def failure_spans_s(
    key: int, *, mtbf_s: float, mttr_s: float, start_s: float, end_s: float
) -> FloatArray:
    """Return the spans (n, 2) of scene time, s, in which something has failed between two times.

    It works at `start_s`. Times between repair and failure have the mean `mtbf_s`, times to repair
    `mttr_s`, both exponential; in the long run it has failed for the share mttr / (mtbf + mttr).
    The last span is cut at `end_s`. `key` is that of a stream (`stream_key`).
    """
    stream = Stream(key, words=2)
    batches = [np.empty((0, 2))]
    time_s = start_s
    while time_s < end_s:
        uniforms = uniforms_of(stream.words(_BATCH * (len(batches) - 1), _BATCH))
        lengths_s = -np.log1p(-uniforms) * np.tile([mtbf_s, mttr_s], _BATCH)
        edges_s = time_s + np.cumsum(lengths_s)
        batches.append(edges_s.reshape(-1, 2))
        time_s = float(edges_s[-1])
    spans_s = np.concatenate(batches)
    spans_s = spans_s[spans_s[:, 0] < end_s]
    return np.minimum(spans_s, end_s)
