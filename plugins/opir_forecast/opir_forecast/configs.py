"""Settings of the forecasters. Nothing heavy is imported here."""

from attrs import frozen

from opir_core.plugin import number


@frozen(kw_only=True)
class RegionsConfig:
    """Settings of the forecaster `regions`."""

    renewal_share: float = number(
        default=0.2,
        minimum=0.0,
        maximum=1.0,
        help="a target that is seen has a new forecast once this share of the age of its burn, or"
        " of its time since burnout, has passed since the last one; 0: each tick",
        source="numerical choice: what a burn yet becomes is uncertain by a factor, the logarithms of"
        " burn times have standard deviations of 0.35 and more",
    )


@frozen(kw_only=True)
class NoForecastConfig:
    """The forecaster `none` has no settings."""


@frozen(kw_only=True)
class ArcConfig:
    """The forecaster `arc` has no settings."""
