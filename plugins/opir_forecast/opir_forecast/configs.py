"""Settings of the forecasters. Nothing heavy is imported here."""

from attrs import frozen

from opir_core.plugin import number


@frozen
class RegionsConfig:
    """Settings of the forecaster `regions`."""

    renewal_share: float = number(
        default=0.2,
        minimum=0.0,
        maximum=1.0,
        help="how old a forecast of a detected target may become, as a share of the time from the"
        " last ignition or burnout to that forecast: with 0.2 one made 50 s after ignition is"
        " renewed after 10 s; 0 renews it at each tick",
        source="numerical choice: what a burn yet becomes is uncertain by a factor, the logarithms of"
        " burn times have standard deviations of 0.35 and more",
    )


@frozen(kw_only=True)
class NoForecastConfig:
    """The forecaster `none` has no settings."""


@frozen(kw_only=True)
class ArcConfig:
    """The forecaster `arc` has no settings."""
