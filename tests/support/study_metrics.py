"""Metrics of studies as the host builds them."""

from collections.abc import Mapping
from typing import Any

from opir_core import Run
from opir_core.plugin import Host, MetricContext, MetricModel


def settings_of(name: str, **settings: Any) -> Any:
    """Return the settings of a metric."""
    return Host.discover().component(MetricModel, name).config(**settings)


def figures_of(name: str, run: Run, **settings: Any) -> Mapping[str, float]:
    """Return the figures of a run by a metric with settings."""
    model = Host.discover().component(MetricModel, name)
    return model.build(model.config(**settings), MetricContext()).values(run)
