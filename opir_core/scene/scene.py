"""The scene: what is simulated, as frozen values. No file is read and nothing is computed here."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from attrs import asdict, field, fields, frozen, has

from opir_core.errors import number_of
from opir_core.notebook import html_view
from opir_core.scene.faults import SensorFault
from opir_core.scene.fields import flag, nested, number, text

if TYPE_CHECKING:
    from opir_core.scene.links import Links

#: The target types a scene may launch, in the order of their codes.
TARGET_TYPES = ("ICBM", "IRBM", "SRBM")

#: The types of sources other than targets; their codes follow those of `TARGET_TYPES`.
SOURCE_TYPES = ("fire", "flare", "glint", "bolide", "other")

#: All emitters, in the order of their codes in a plan.
EMITTER_TYPES = (*TARGET_TYPES, *SOURCE_TYPES)

#: The target types that an event can report, in the order of their codes.
REPORTED_TYPES = (*TARGET_TYPES, "UNKNOWN")

#: What a scene's events may report: the types of the paper, `REPORTED_TYPES`, or the names of
#: target classes as well.
PAPER_TYPES = "paper"
CLASS_TYPES = "classes"

#: The code of UNKNOWN in `REPORTED_TYPES`.
UNKNOWN_TYPE = REPORTED_TYPES.index("UNKNOWN")

#: The default signature model of targets.
DEFAULT_SIGNATURE = "plume"


#: The bands that confirm a detection are a mask of eight bits.
MAXIMUM_BANDS = 8


@frozen
class Choice:
    """A component chosen by name, with its configuration.

    `hook` is its catalogue hook, `path` its path in the scene (`sensors[2]`, `detection`). `spool`
    is the `SpoolConfig` of an output, or None.

    `reason` is why `auto` chose it, "" if the scene names it. `written` has the places in the file
    of what the scene sets and not every scene reads: of its settings by their keys, dotted inside
    nested blocks, and of the component itself by ""; nothing if the scene does not name it. They
    have no part in equality.
    """

    hook: str
    name: str
    config: Any
    path: str
    spool: Any = None
    reason: str = field(default="", eq=False, repr=False)
    written: Mapping[str, str] = field(factory=dict, eq=False, repr=False)

    @property
    def parts(self) -> "Mapping[str, Choice]":
        """Return the choices of parts in the configuration, by their keys."""
        config_class: type = type(self.config)
        names = [item.name for item in fields(config_class)] if has(config_class) else []
        values = {name: getattr(self.config, name) for name in names}
        return {name: value for name, value in values.items() if isinstance(value, Choice)}


@frozen
class SceneSensor:
    """One satellite's sensor: its id (unique in the scene), its model, and the constellation it
    came from, if any.
    """

    id: str
    model: Choice
    constellation: str | None = None

    def __repr__(self) -> str:
        """Return id and model, in one line."""
        return f"<SceneSensor {self.id}: {self.model.name}>"

    def _repr_html_(self) -> str:
        """Return the settings for a notebook."""
        return _settings_view(self)


@frozen
class SceneTarget:
    """One launch: its id (unique in the scene), its target model, and its signature model (None:
    the default one).
    """

    id: str
    model: Choice
    signature: Choice | None = None

    def __repr__(self) -> str:
        """Return id and model, in one line."""
        return f"<SceneTarget {self.id}: {self.model.name}>"

    def _repr_html_(self) -> str:
        """Return the settings for a notebook."""
        return _settings_view(self)


def _settings_view(part: SceneSensor | SceneTarget) -> str:
    """Return the settings of a part of a scene as HTML."""
    settings = asdict(part.model.config, recurse=False)
    return html_view(part, ("setting", "value"), list(settings.items()), len(settings))


@frozen
class SceneSource:
    """A block of sources: its id (unique in the scene) and its source model."""

    id: str
    model: Choice


@frozen
class ExponentialAir:
    """Exponential air density."""

    density_kg_m3: float = number(
        unit="kg/m³", above=0.0, maximum=100.0, help="density at the base height"
    )
    scale_height_m: float = number(unit="m", minimum=100.0, maximum=1e6, help="scale height")
    base_height_m: float = number(
        default=0.0,
        unit="m",
        minimum=-5000.0,
        maximum=1e6,
        help="height above the WGS 84 ellipsoid",
    )


@frozen
class SceneDrag:
    """Drag in free flight, in air that rotates with the Earth."""

    ballistic_coefficient_kg_m2: float = number(
        default=5000.0,
        unit="kg/m²",
        minimum=1.0,
        maximum=1e6,
        help="m/(C_d A) of targets without their own value",
    )
    exponential: ExponentialAir | None = nested(
        default=None,
        source="U.S. Standard Atmosphere, 1976",
        help="exponential density; default: U.S. Standard Atmosphere, 1976, up to 1000 km",
    )


@frozen
class SceneForces:
    """Forces in free flight besides the point mass: zonal harmonics by name, in order, and drag."""

    zonal: tuple[str, ...] = ()
    drag: SceneDrag | None = None

    @property
    def is_kepler(self) -> bool:
        """Whether only the point mass acts."""
        return not self.zonal and self.drag is None

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the forces, as in scenes."""
        return (*self.zonal, *(() if self.drag is None else ("drag",))) or ("kepler",)


#: Plausible durations of a scene, s.
PLAUSIBLE_DURATION_S = (0.001, 604_800.0)


@frozen
class WorkLimits:
    """The most work of a scene that is accepted, for the whole run and for one cycle of a live
    run.
    """

    looks_per_run: float = number(
        default=1e10,
        minimum=1.0,
        maximum=1e15,
        source="derived: half an hour of one core at 5 million looks a second",
        help="looks of the whole scene",
    )
    events_per_run: float = number(
        default=1e10,
        minimum=1.0,
        maximum=1e15,
        source="derived: as many as looks",
        help="events of the whole scene, at most one per look, and false alarms",
    )
    bytes_per_run: float = number(
        default=2e13,
        unit="bytes",
        minimum=1.0,
        maximum=1e18,
        source="derived: 2000 bytes per event",
        help="bytes of these events",
    )
    false_alarms_per_s: float = number(
        default=1e5,
        unit="1/s",
        minimum=1.0,
        maximum=1e12,
        source="derived: 10 µs an event, a second of one core",
        help="mean false alarms of all sensors in a second of scene time",
    )
    looks_per_cycle: float = number(
        default=4_194_304,
        minimum=1.0,
        maximum=1e12,
        source="derived: 16 windows, about a second of one core",
        help="looks of one cycle of a live run",
    )
    events_per_cycle: float = number(
        default=4_194_304,
        minimum=1.0,
        maximum=1e12,
        source="derived: as many as looks",
        help="events of one cycle of a live run, at most one per look, and false alarms",
    )
    bytes_per_cycle: float = number(
        default=8_388_608_000,
        unit="bytes",
        minimum=1.0,
        maximum=1e15,
        source="derived: 2000 bytes per event",
        help="bytes of these events",
    )


#: The orders in which the tracker gets detections.
BY_OBSERVATION = "observation"
BY_REPORT = "report"


@frozen(repr=False)
class Scene:
    """A whole scene.

    `epoch_us` is the start of scene time, in microseconds of UTC since 1970-01-01 (no leap
    seconds). `light_time` is whether light travels at finite speed. `reported_types` says whether
    events report `REPORTED_TYPES` only, or target classes too. In the `tracking_order` of report
    the tracker is stepped `tracking_lag_s` after its ticks, None for the time within which nearly
    all reports come.
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
    atmosphere: Choice
    background: Choice
    sources: tuple[SceneSource, ...] = ()
    outputs: tuple[Choice, ...] = ()
    light_time: bool = True
    forces: SceneForces = SceneForces()
    tracking_order: str = BY_OBSERVATION
    tracking_lag_s: float | None = None
    reported_types: str = PAPER_TYPES
    limits: WorkLimits = WorkLimits()
    allow_implausible: bool = False
    #: By sensor the spans in which it looks, s; other sensors look throughout.
    watched_s: Mapping[str, tuple[tuple[float, float], ...]] = field(factory=dict, hash=False)
    faults: tuple[SensorFault, ...] = ()
    #: How reports get to the ground; None: as soon as sensors make them.
    links: "Links | None" = None
    #: What points sensors with a narrow field during the run; None: they stay as they are.
    director: Choice | None = None
    #: The keys of the file that are set to other values than their defaults.
    written: Mapping[str, Any] = field(factory=dict, eq=False)

    def __repr__(self) -> str:
        """Return the scene in one line."""
        of = f"{number_of('sensor', len(self.sensors))}, {number_of('target', len(self.targets))}"
        return (
            f"<Scene {self.name}: {of}, tracker {self.tracker.name}, {self.duration_s:g} s, seed"
            f" {self.seed}>"
        )

    def _repr_html_(self) -> str:
        """Return the sensors and targets for a notebook."""
        parts: tuple[Any, ...] = (*self.sensors, *self.targets, *self.sources)
        rows = [
            (item.id, type(item).__name__.removeprefix("Scene").lower(), item.model.name)
            for item in parts
        ]
        return html_view(self, ("id", "kind", "model"), rows)

    @property
    def choices(self) -> tuple[Choice, ...]:
        """Return every chosen component, in the order of the scene file."""
        signatures = (target.signature for target in self.targets)
        return (
            *(sensor.model for sensor in self.sensors),
            *(target.model for target in self.targets),
            *(choice for choice in signatures if choice is not None),
            *(source.model for source in self.sources),
            self.detection,
            self.classification,
            self.confidence,
            self.tracker,
            *self.tracker.parts.values(),
            *(() if self.director is None else (self.director,)),
            self.atmosphere,
            self.background,
            *self.outputs,
        )

    @property
    def fails_at_random(self) -> bool:
        """Whether a fault or an outage of a link comes at random, by the seed."""
        outages = () if self.links is None else self.links.outages
        return any(fault.mtbf_s is not None for fault in self.faults) or any(
            outage.mtbf_s is not None for outage in outages
        )

    @property
    def automatic(self) -> list[str]:
        """Return the components that `auto` chose, each with the reason: `detection: snr, since
        ...`.
        """
        return [
            f"{choice.path}: {choice.name}, since {choice.reason}"
            for choice in self.choices
            if choice.reason
        ]


#: What a spool does when it is full.
REFUSE = "refuse"
WAIT = "wait"
DROP_OLDEST = "drop-oldest"
DROP_NEWEST = "drop-newest"
_MIB = 1 << 20


@frozen
class SpoolConfig:
    """A spool: the file that keeps events until they are acknowledged, its size, and the policy
    when it is full.
    """

    path: str = text(
        help="the spool's file (SQLite), created in an existing folder if missing", source=""
    )
    max_bytes: int = number(
        default=1024 * _MIB,
        unit="bytes",
        minimum=_MIB,
        maximum=1 << 44,
        help="maximum size of the file; SQLite's journal takes a few MiB more",
    )
    when_full: str = text(
        default=REFUSE,
        choices=(REFUSE, WAIT, DROP_OLDEST, DROP_NEWEST),
        help="policy of a full spool: refuse fails the output and keeps the spooled events; wait"
        " holds"
        " the run until there is room; drop-oldest and drop-newest drop events and count them",
    )
    wait_s: float = number(
        default=60.0,
        unit="s",
        minimum=0.0,
        maximum=86_400.0,
        help="longest wait of the policy wait, then it refuses",
    )
    survives_power_cut: bool = flag(
        default=False,
        help="whether each write waits for the disk; otherwise events survive the end of the"
        " process"
        ", but the last may be lost in a power failure",
    )

    def __attrs_post_init__(self) -> None:
        if not self.path or "\0" in self.path:
            raise ValueError("the spool's path is empty; give the path of a file")
