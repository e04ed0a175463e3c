"""The forecasters `regions` and `none`; each is imported when it is built."""

from collections.abc import Iterable
from typing import Any

from opir_core.plugin import TrackerPart, hookimpl
from opir_forecast.configs import ArcConfig, NoForecastConfig, RegionsConfig


def _regions(config: RegionsConfig, context: Any) -> Any:
    from opir_forecast.region_forecaster import region_forecaster

    return region_forecaster(config, context)


def _arc(config: ArcConfig, context: Any) -> Any:
    from opir_forecast.arc import arc_forecaster

    return arc_forecaster(config, context)


def _none(config: NoForecastConfig, context: Any) -> Any:
    from opir_forecast.forecaster import no_forecast

    return no_forecast(config, context)


@hookimpl
def opir_tracker_parts() -> Iterable[TrackerPart]:
    """Yield the forecasters of any tracker."""
    yield TrackerPart(
        name="regions",
        summary="hypotheses and impact regions from boosts of a law of stages, conditioned on the"
        " track",
        role="forecast",
        config=RegionsConfig,
        build=_regions,
        reads=(),
    )
    yield TrackerPart(
        name="arc",
        summary="the Keplerian arc of a target that no longer burns, with the covariance of its"
        " impact",
        role="forecast",
        config=ArcConfig,
        build=_arc,
        reads=(),
    )
    yield TrackerPart(
        name="none",
        summary="no forecast: states and launch points alone",
        role="forecast",
        config=NoForecastConfig,
        build=_none,
        reads=(),
    )
