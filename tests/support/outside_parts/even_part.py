"""A forecaster from outside: what flies lands, all classes are alike, and nobody knows where."""

import numpy as np
from opir_forecast import Forecaster, LaunchForecasts

from opir_core.plugin import TrackerPart, hookimpl


class Even(Forecaster):
    def __init__(self, hypotheses):
        self.share = np.array([hypothesis.is_launch for hypothesis in hypotheses], dtype=float)

    def forecasts(self, estimates, time_s):
        even = np.tile(self.share / self.share.sum(), (len(estimates), 1))
        unknown = np.full(len(estimates), np.nan)
        falls = np.ones(len(estimates))
        return LaunchForecasts.without_impacts(even, estimates.burning, unknown, falls, unknown)


def even(config, context):
    return Even(context.tracker.hypotheses)


@hookimpl
def opir_tracker_parts():
    yield TrackerPart(
        name="even", summary="all classes alike", role="forecast", build=even, reads=()
    )
