"""The core's plugin of its target classes, imported for scenes that name one; see
`CORE_PLUGINS`.
"""

from collections.abc import Iterable

from opir_core.host.hookspecs import hookimpl
from opir_core.scene.target_classes import TargetClass, core_target_classes


@hookimpl
def opir_target_classes() -> Iterable[TargetClass]:
    """Yield the classes of `opir_core/data/target_classes.json`."""
    return core_target_classes().values()
