"""Settings of the detection model `snr`; imports nothing heavy."""

from attrs import frozen

from opir_core.plugin import flag, number, text

CALIBRATIONS = ("none", "paper")


@frozen
class SnrConfig:
    """Settings of the detection model `snr`."""

    calibrate: str = text(
        default="none",
        choices=CALIBRATIONS,
        help="none: the sensors' noise as configured; paper: each sensor's noise-equivalent"
        " irradiances times the one factor with which it detects the reference ICBM (solid, 30 s"
        " after ignition, at 25 km, from the side, 36 000 km away, through no air, before no"
        " background) with its detection_probability for ICBM; fainter classes, and any through"
        " air, are then mostly below the threshold",
    )
    probability_tolerance: float = number(
        default=1e-4,
        minimum=1e-12,
        maximum=0.1,
        help="how far probabilities of detection may be off between the moments at which they are"
        " evaluated",
        read_if=("with exact: false", lambda config: not config.exact),
    )
    exact: bool = flag(
        default=False, source="cost", help="evaluate every look, and interpolate nothing"
    )
