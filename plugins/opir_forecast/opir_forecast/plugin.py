"""The forecasters `regions` and `none`; each is imported when it is built."""

from collections.abc import Iterable

from opir_core.plugin import TrackerPart, deferred, hookimpl
from opir_forecast.configs import ArcConfig, NoForecastConfig, RegionsConfig


@hookimpl
def opir_tracker_parts() -> Iterable[TrackerPart]:
    """Yield the forecasters of any tracker."""
    yield TrackerPart(
        name="regions",
        summary="hypotheses and impact regions from boosts of a law of stages, conditioned on the"
        " track",
        role="forecast",
        config=RegionsConfig,
        build=deferred("opir_forecast.region_forecaster.region_forecaster"),
        reads=(),
    )
    yield TrackerPart(
        name="arc",
        summary="the Keplerian arc of a target that no longer burns, with the covariance of its"
        " impact",
        role="forecast",
        config=ArcConfig,
        build=deferred("opir_forecast.arc.arc_forecaster"),
        reads=(),
    )
    yield TrackerPart(
        name="none",
        summary="no forecast: states and launch points alone",
        role="forecast",
        config=NoForecastConfig,
        build=deferred("opir_forecast.forecaster.no_forecast"),
        reads=(),
    )
