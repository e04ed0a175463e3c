"""The tracker `stonesoup`: Stone Soup is imported when the tracker is built."""

from collections.abc import Iterable

from opir_core.plugin import TrackerModel, deferred, hookimpl
from opir_stonesoup.settings import StoneSoupConfig


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
