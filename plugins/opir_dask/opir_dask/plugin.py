"""The executor `dask`; Dask is imported when a study uses it."""

from collections.abc import Iterable
from typing import Any

from attrs import frozen

from opir_core.plugin import ExecutorContext, ExecutorModel, hookimpl, number, text


@frozen
class DaskConfig:
    """The settings of the executor `dask`."""

    address: str = text(
        help="address of a scheduler, tcp://HOST:8786; '' starts workers on this computer",
        default="",
        source="arbitrary",
    )
    workers: int | None = number(
        help="number of workers on this computer; --workers takes precedence",
        default=None,
        minimum=1,
        maximum=4096,
        source="as many as there are cores",
    )
    timeout_s: float = number(
        help="time to wait for the scheduler, and for a worker once there is none",
        default=30.0,
        unit="s",
        above=0.0,
        maximum=3600.0,
        source="arbitrary",
    )


def _built(config: DaskConfig, context: ExecutorContext) -> Any:
    from opir_dask.executor import DaskExecutor

    return DaskExecutor(config.address, context.workers or config.workers, config.timeout_s)


@hookimpl
def opir_executors() -> Iterable[ExecutorModel]:
    """Yield the executor `dask`."""
    summary = "Dask distributed: a cluster by its address, or workers on this computer"
    yield ExecutorModel(name="dask", summary=summary, config=DaskConfig, build=_built)
