"""The scene: what is simulated, as frozen values. No file is read and nothing is computed here."""

from typing import Any

from attrs import frozen

#: The target types a scene may launch, in the order of their codes.
TARGET_TYPES = ("ICBM", "IRBM", "SRBM")

#: What else a scene may put on the ground or in the air that is hot; their codes follow those of `TARGET_TYPES`.
SOURCE_TYPES = ("fire", "flare", "glint", "bolide", "other")

#: All that radiates, in the order of the codes of a plan's targets.
EMITTER_TYPES = (*TARGET_TYPES, *SOURCE_TYPES)

#: What an event may report as its target type, in the order of their codes.
REPORTED_TYPES = (*TARGET_TYPES, "UNKNOWN")

#: The code of "no answer" among `REPORTED_TYPES`.
UNKNOWN_TYPE = REPORTED_TYPES.index("UNKNOWN")


@frozen
class Choice:
    """A component chosen by name, with its configuration.

    `hook` is the catalogue hook it came through, `path` where in the scene it stands (`sensors[2]`, `detection`).
    """

    hook: str
    name: str
    config: Any
    path: str


@frozen
class SceneSensor:
    """One satellite's sensor: its id (unique in the scene), its model, and the constellation it came from, if any."""

    id: str
    model: Choice
    constellation: str | None = None


@frozen
class SceneTarget:
    """One launch: its id (unique in the scene) and its target model."""

    id: str
    model: Choice


@frozen
class Scene:
    """A whole scene.

    `epoch_us` is the scene's zero of time, in microseconds of UTC since 1970-01-01 (no leap seconds). `light_time` says
    whether light takes time from target to sensor. `atmosphere` and `background` are None where the scene names none.
    """

    name: str
    epoch_us: int
    duration_s: float
    seed: int
    sensors: tuple[SceneSensor, ...]
    targets: tuple[SceneTarget, ...]
    detection: Choice
    classification: Choice
    confidence: Choice
    tracker: Choice
    outputs: tuple[Choice, ...] = ()
    light_time: bool = True
    atmosphere: Choice | None = None
    background: Choice | None = None

    @property
    def choices(self) -> tuple[Choice, ...]:
        """Return every component that the scene chose, in the order of the scene file."""
        optional = (self.atmosphere, self.background)
        return (
            *(sensor.model for sensor in self.sensors),
            *(target.model for target in self.targets),
            self.detection,
            self.classification,
            self.confidence,
            self.tracker,
            *(choice for choice in optional if choice is not None),
            *self.outputs,
        )
