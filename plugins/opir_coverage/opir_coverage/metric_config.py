"""The settings of the metric `coverage`; nothing heavy is imported."""

from attrs import frozen

from opir_core.plugin import number


@frozen
class CoverageMetricConfig:
    """What a study's coverage is of: points at rest above a grid, over a day from the scene's
    epoch.
    """

    height_km: float = number(
        default=10.0, unit="km", minimum=0.0, maximum=10_000.0, help="height of the points"
    )
    grid_deg: float = number(
        default=10.0, unit="deg", minimum=0.5, maximum=90.0, help="step of the grid; divides 180"
    )
    steps: int = number(default=96, minimum=1, maximum=10_000, help="instants of the day")
    assets: int = number(
        default=1, minimum=1, maximum=100, help="least number of sensors in view to be covered"
    )
