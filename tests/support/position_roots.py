"""Roots of the position covariances of predictions, term by term."""

from opir_estimation import PredictedMeasurements

from opir_core.arrays import FloatArray, IntArray


def position_roots(
    predicted: PredictedMeasurements, track: IntArray, time_s: FloatArray
) -> FloatArray:
    """Return A (m, 3, 12) with A Aᵀ the position covariance of tracks (m,) at times (m,)."""
    weight = predicted.weights(time_s)[:, :, None, None]
    blocks = predicted.root.reshape(len(predicted.root), 4, 3, -1)
    total: FloatArray = blocks[track, 0]
    for order in range(1, 4):
        total += blocks[track, order] * weight[:, order]
    return total
