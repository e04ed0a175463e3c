"""What components are built with: each kind's context, which `build` is given beside the configuration."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from attrs import field, frozen
from numpy.typing import NDArray

from opir_core.interfaces.protocols import DetectionProbability, Encoder, Sensor

if TYPE_CHECKING:
    from opir_core.flight.forces import ForceModel


@frozen(kw_only=True)
class SensorContext:
    """What a sensor model is built with."""

    id: str
    epoch_us: int


@frozen(kw_only=True)
class TargetContext:
    """What a target model is built with: the ids and scene paths of its targets, row by row with the configurations.

    `forces` act in free flight: "kepler", or `opir_core.flight.Forces`, whose drag has the ballistic coefficient of
    targets that do not bring their own. `epoch_us` is the scene's zero of time, microseconds of UTC since 1970-01-01.
    With `free_flight` a sensor follows targets after burnout: a model that can gives them `FreeFlight` to impact.
    """

    ids: tuple[str, ...]
    paths: tuple[str, ...]
    forces: "ForceModel" = "kepler"
    epoch_us: int = 0
    free_flight: bool = False


@frozen(kw_only=True)
class ModelContext:
    """What detection models are built with and, with the built `detection`, those of classification and confidence.

    `make_environment` returns the `opir_core.planning.environment.RadiometricEnvironment`; it is built when a model
    first asks for it.
    """

    sensors: tuple[Sensor, ...]
    target_type_code: NDArray[np.uint8] = field(eq=False)  #: into `EMITTER_TYPES`: launches, then other hot sources
    make_environment: Callable[[], Any] | None = field(default=None, eq=False)
    detection: DetectionProbability | None = field(default=None, eq=False)


@frozen(kw_only=True)
class TrackerContext:
    """What trackers are built with: no targets, for a tracker sees detections alone.

    `forces` act in free flight: "kepler", or `opir_core.flight.Forces`. `light_time` says whether light takes its time.
    """

    sensors: tuple[Sensor, ...]
    epoch_us: int
    duration_s: float
    forces: "ForceModel" = "kepler"
    light_time: bool = True


@frozen(kw_only=True)
class EncoderContext:
    """What encoders are built with."""

    sensors: tuple[Sensor, ...]
    epoch_us: int


@frozen(kw_only=True)
class SinkContext:
    """What sinks are built with.

    `make_encoder` returns the encoder that the output's block names (`encoder: NAME`); what it needs is imported only
    then, so a sink that never encodes never asks. `resumes` is true where a spool may hold events of an earlier run:
    what is already at the sink's place is to be added to, not overwritten.
    """

    make_encoder: Callable[[], Encoder]
    scene_name: str
    resumes: bool = False
