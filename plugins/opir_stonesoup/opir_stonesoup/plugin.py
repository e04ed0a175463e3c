"""The tracker and the director `stonesoup`: Stone Soup is imported when one of them is built."""

from collections.abc import Iterable

from opir_core.plugin import DirectorModel, TrackerModel, deferred, hookimpl
from opir_stonesoup.settings import StoneSoupConfig, StoneSoupDirectorConfig


@hookimpl
def opir_trackers() -> Iterable[TrackerModel]:
    """Yield the tracker `stonesoup`."""
    yield TrackerModel(
        name="stonesoup",
        summary="Stone Soup's multi-target tracker: EKF or UKF, GNN or JPDA, with opir's motion and"
        " measurement models",
        config=StoneSoupConfig,
        build=deferred("opir_stonesoup.tracker.stone_soup_tracker"),
        reads=(),
    )


@hookimpl
def opir_directors() -> Iterable[DirectorModel]:
    """Yield the director `stonesoup`."""
    yield DirectorModel(
        name="stonesoup",
        summary="Stone Soup's sensor managers: each sensor to a track, by the uncertainty that its"
        " looks would take away",
        config=StoneSoupDirectorConfig,
        build=deferred("opir_stonesoup.director.stone_soup_director"),
    )
