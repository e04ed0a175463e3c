"""The sinks `cot` and `dis`: tracks for the displays of other programs."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from opir_core.plugin import SinkModel, hookimpl
from opir_displays.settings import CotConfig, DisConfig

if TYPE_CHECKING:
    from opir_core.plugin import Sink, SinkContext


def _cot(config: CotConfig, context: "SinkContext") -> "Sink":
    from opir_displays.cursor_on_target import CotEvents
    from opir_displays.display_sink import opened

    events = CotEvents(config, context.origin.epoch_us, context.scene_name)
    return opened(config, context, events, config.file)


def _dis(config: DisConfig, context: "SinkContext") -> "Sink":
    from opir_displays.display_sink import opened
    from opir_displays.entity_states import EntityStates

    return opened(config, context, EntityStates(config, context.origin.epoch_us))


@hookimpl
def opir_sinks() -> Iterable[SinkModel]:
    """Yield the sinks `cot` and `dis`."""
    yield SinkModel(
        name="cot",
        summary="tracks, launch and impact points as Cursor on Target events, over UDP or in a file",
        config=CotConfig,
        build=_cot,
    )
    yield SinkModel(
        name="dis",
        summary="tracks as DIS Entity State PDUs (IEEE 1278.1-2012) over UDP",
        config=DisConfig,
        build=_dis,
    )
