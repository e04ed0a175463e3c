"""The tracker `stonesoup`: Stone Soup is imported when the tracker is built."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from opir_core.plugin import TrackerModel, hookimpl
from opir_stonesoup.settings import StoneSoupConfig

if TYPE_CHECKING:
    from opir_core.plugin import Tracker, TrackerContext


def _stonesoup(config: StoneSoupConfig, context: "TrackerContext") -> "Tracker":
    from opir_stonesoup.tracker import stone_soup_tracker

    return stone_soup_tracker(config, context)


@hookimpl
def opir_trackers() -> Iterable[TrackerModel]:
    """Yield the tracker `stonesoup`."""
    yield TrackerModel(
        name="stonesoup",
        summary="Stone Soup's multi-target tracker: EKF or UKF, GNN or JPDA, with opir's motion and"
        " measurement models",
        config=StoneSoupConfig,
        build=_stonesoup,
        reads=(),
    )
