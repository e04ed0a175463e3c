"""The configuration of a sensor's reporting latency. Nothing heavy is imported here."""

import math

from attrs import frozen

from opir_core.scene.fields import nested, number

#: Largest standard deviation of a stage, in means: beyond it nearly all latencies of a gamma
#: distribution are 0.
_MOST_SIGMA = 10.0


@frozen
class ReportingStageConfig:
    """The latency of one stage of reporting: constant, or gamma distributed if it has a standard
    deviation.
    """

    mean_s: float = number(
        default=0.0,
        unit="s",
        minimum=0.0,
        maximum=86_400.0,
        source="0: no latency",
        help="mean latency",
    )
    sigma_s: float = number(
        default=0.0,
        unit="s",
        minimum=0.0,
        maximum=86_400.0,
        source="0: a constant latency",
        help="standard deviation of the latency, at most ten times its mean; above 0 the latency is"
        " gamma distributed",
    )

    def __attrs_post_init__(self) -> None:
        if self.sigma_s > _MOST_SIGMA * self.mean_s:
            raise ValueError(
                f"sigma_s: {self.sigma_s:g} s is more than ten times mean_s, {self.mean_s:g} s;"
                f" give a larger mean_s"
            )


_AT_ONCE = "0: no latency"


@frozen
class ReportingConfig:
    """The stages between a look and its report; their latencies add up."""

    on_board: ReportingStageConfig = nested(
        default=ReportingStageConfig(),
        source=_AT_ONCE,
        help="processing on board, up to transmission",
    )
    downlink: ReportingStageConfig = nested(
        default=ReportingStageConfig(),
        source=_AT_ONCE,
        help="transmission to the ground, relays included",
    )
    processing: ReportingStageConfig = nested(
        default=ReportingStageConfig(),
        source=_AT_ONCE,
        help="processing on the ground, up to the report",
    )


#: "Typically 20-50 s for the legacy DSP ground chain" (opir-simulator paper (2026), section 8.1):
#: mean and standard deviation of the uniform distribution over this range. The paper does not
#: divide the chain into stages, and a typical range is no bound: 93 % of the gamma distribution
#: with these moments are in it.
_PAPER_GROUND_CHAIN = ReportingStageConfig(mean_s=35.0, sigma_s=30.0 / math.sqrt(12.0))

#: The latencies that a scene may write by name instead of a block.
PRESETS = {
    "none": ReportingConfig(),
    "paper-ground-chain": ReportingConfig(processing=_PAPER_GROUND_CHAIN),
}
