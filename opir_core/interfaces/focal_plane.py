"""The settings of a sensor's focal plane: optics, detectors, spatial and temporal filter, jitter
and drift.

A sensor's configuration holds them, its `Radiometer` carries them, detection models work out what
they come to.
"""

from attrs import frozen

from opir_core.scene.fields import number, text

SPATIAL_FILTERS = ("sum", "surround", "matched")
TEMPORAL_FILTERS = ("difference", "none")

_DIFFERENCE = (
    "with temporal_filter: difference",
    lambda plane: plane.temporal_filter == "difference",
)


@frozen
class FocalPlaneConfig:
    """What a scene may set of a focal plane; pixels are as wide as the sensor's `ifov_urad`."""

    aperture_m: float = number(
        default=0.6,
        unit="m",
        above=0.0,
        maximum=100.0,
        plausible=(0.01, 10.0),
        help="diameter of the aperture",
    )
    optics_transmission: float = number(
        default=0.7, above=0.0, maximum=1.0, help="share of light that the optics pass"
    )
    optics_temperature_k: float = number(
        default=250.0,
        unit="K",
        minimum=0.0,
        maximum=1e4,
        help="of optics of emissivity 1 - transmission",
    )
    f_number: float = number(
        default=2.0,
        minimum=0.5,
        maximum=100.0,
        help="focal length over aperture, 0.5 at least in air (sine condition): sets the pitch of"
        " pixels, ifov · f · D",
    )
    fill_factor: float = number(
        default=0.9, above=0.0, maximum=1.0, help="share of a pixel that detects"
    )
    quantum_efficiency: float = number(
        default=0.7, above=0.0, maximum=1.0, help="electrons per photon on a pixel"
    )
    integration_time_ms: float = number(
        default=10.0,
        unit="ms",
        above=0.0,
        maximum=1e6,
        plausible=(0.001, 10_000.0),
        help="integration time of a frame, all its subframes together; a scan period at most",
    )
    subframes: int = number(
        default=16,
        minimum=1,
        maximum=1_000_000,
        help="subframes added up to a frame, each read out by itself",
    )
    detector_temperature_k: float = number(
        default=110.0,
        unit="K",
        above=0.0,
        maximum=1e4,
        plausible=(3.0, 350.0),
        help="temperature of the detectors",
        read_if=("without dark_current_e_s", lambda plane: plane.dark_current_e_s is None),
    )
    dark_current_e_s: float | None = number(
        default=None,
        unit="e⁻/s",
        minimum=0.0,
        maximum=1e15,
        source="Rule 07 (W. E. Tennant, J. Electron. Mater. 39, 2010, 1030), cut off at the long"
        " edge of the band",
        help="electrons of a pixel without any light",
    )
    read_noise_e: float = number(
        default=100.0,
        unit="e⁻",
        minimum=0.0,
        maximum=1e9,
        help="standard deviation of reading a pixel of a subframe",
    )
    well_capacity_e: float = number(
        default=2e7, unit="e⁻", above=0.0, maximum=1e18, help="electrons that a pixel holds"
    )
    bits: int = number(
        default=16, minimum=1, maximum=64, help="of the converter, over the well's capacity"
    )
    blur_urad: float = number(
        default=9.0,
        unit="urad",
        minimum=0.0,
        maximum=1e5,
        help="standard deviation per axis of blur besides diffraction: aberrations, crosstalk",
    )
    jitter_urad: float = number(
        default=2.5,
        unit="urad",
        minimum=0.0,
        maximum=1e5,
        help="standard deviation per axis of the line of sight within an integration: it blurs",
    )
    registration_urad: float = number(
        default=0.5,
        unit="urad",
        minimum=0.0,
        maximum=1e5,
        help="standard deviation per axis with which a frame is registered, new from frame to"
        " frame: it lets clutter"
        " through the frame difference",
        read_if=_DIFFERENCE,
    )
    drift_urad_s: float = number(
        default=0.02,
        unit="urad/s",
        minimum=0.0,
        maximum=1e6,
        help="rate at which the line of sight drifts over the scene, uncorrected: it smears, and"
        " lets clutter through",
    )
    core_pixels: int = number(
        default=1,
        minimum=1,
        maximum=9,
        help="pixels along a side of the square in which the spatial filter adds",
    )
    spatial_filter: str = text(
        default="matched",
        choices=SPATIAL_FILTERS,
        help="sum: of the core; surround: less the mean of a ring of pixels around it; matched:"
        " weights of the spot in"
        " the core and two pixels around it, less their mean",
    )
    temporal_filter: str = text(
        default="difference",
        choices=TEMPORAL_FILTERS,
        help="difference: of a frame and one lag_s earlier, with twice the variance of noise; none:"
        " a single frame",
    )
    lag_s: float = number(
        default=10.0,
        unit="s",
        above=0.0,
        maximum=1e5,
        help="age of the earlier frame, at least a scan period",
        read_if=_DIFFERENCE,
    )
    reference_cells: int | None = number(
        default=None,
        minimum=8,
        maximum=1_000_000,
        source="no default: noise and clutter known exactly",
        help="cells from which the threshold estimates noise and clutter (cell-averaging CFAR);"
        " fewer lose more",
    )
    phase: str = text(
        default="mean",
        choices=("mean", "worst"),
        help="where on its pixel a point source is: the mean over all places, or on the corner of"
        " four pixels",
    )
