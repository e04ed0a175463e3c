"""Targets whose trajectories come from files; what reads them is imported when a scene names one."""

from collections.abc import Iterable, Sequence

from opir_core.plugin import TargetContext, TargetModel, Trajectories, hookimpl
from opir_readers.configs import TableConfig


@hookimpl
def opir_target_models() -> Iterable[TargetModel]:
    """Yield `table`."""
    yield TargetModel(
        name="table",
        summary="a trajectory from a file: a table of states, CSV or CCSDS OEM",
        config=TableConfig,
        build=_table,
    )


def _table(configs: Sequence[TableConfig], context: TargetContext) -> Trajectories:
    from opir_readers.table_targets import table_targets

    return table_targets(configs, context)
