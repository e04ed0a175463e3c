"""Contracts of signature, source, atmosphere and background models, their contexts, and the columns
they work on.

`band` is an index into the `bands` of the context of a model: the distinct bands of the scene's
sensors. A model that does not support one of them raises `ModelError` when it is built. Results are
finite and element by element: they do not depend on how rows are grouped into calls.
"""

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

import numpy as np
from attrs import Factory, field, frozen

from opir_core.arrays import FloatArray, IndexArray
from opir_core.flight.burns import one_burn_s
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.contract import PluginPart, optional, required, undefined
from opir_core.interfaces.sensors import Band
from opir_core.interfaces.trajectories import Trajectories
from opir_core.scene.target_classes import Plume


@frozen(eq=False, repr=False)
class Paths(Columns):
    """Paths of light from targets to sensors, one row each; the arguments of
    `Transmittance.transmittance`.

    `height_m` is the target's height above the WGS 84 ellipsoid; `elevation_sine` that of the
    sensor above the target's horizon; `target_ecef_m` and `sensor_ecef_m` are positions (n, 3), m;
    `time_s` is scene time.
    """

    row_shapes: ClassVar[Mapping[str, tuple[int, ...]]] = {
        "target_ecef_m": (3,),
        "sensor_ecef_m": (3,),
    }

    height_m: FloatArray
    elevation_sine: FloatArray
    target_ecef_m: FloatArray
    sensor_ecef_m: FloatArray
    time_s: FloatArray


@frozen(eq=False, repr=False)
class Views(Columns):
    """Views along lines of sight, one row each; the arguments of `Background.radiance_w_m2_sr`.

    `point_ecef_m` (n, 3) is where the line of sight meets the WGS 84 ellipsoid or, where it misses
    it, the point of the line that comes nearest to it. `height_m` is that point's height: 0 on the
    Earth, the tangent height beyond the limb (inf where the line only leads away from the Earth).
    `elevation_sine` is of the sensor above the point's horizon, 0 beyond the limb;
    `sun_elevation_sine` of the Sun above it; `time_s` is scene time. `line_of_sight_ecef` (n, 3)
    are unit vectors from the sensor, nan where the maker of the record does not know them.
    """

    row_shapes: ClassVar[Mapping[str, tuple[int, ...]]] = {"point_ecef_m": (3,)}

    height_m: FloatArray
    elevation_sine: FloatArray
    sun_elevation_sine: FloatArray
    point_ecef_m: FloatArray
    time_s: FloatArray
    line_of_sight_ecef: FloatArray = field(
        default=Factory(lambda rows: np.full((len(rows.time_s), 3), np.nan), takes_self=True)
    )


class Signatures(PluginPart):
    """Radiant intensities of the targets of one model; rows are those of the context (or the
    `Sources`).

    >>> class Torch(Signatures):
    ...     def intensity_w_sr(self, band, target, time_since_ignition_s, altitude_m, aspect_rad):
    ...         return np.full(len(target), 2e5)
    >>> Torch().intensities_w_sr([0, 1], np.array([0]), np.array([10.0]), np.array([3e4]), np.array([1.6]))
    array([[200000.],
           [200000.]])
    """

    @abstractmethod
    def intensity_w_sr(
        self,
        band: int,
        target: IndexArray,
        time_since_ignition_s: FloatArray,
        altitude_m: FloatArray,
        aspect_rad: FloatArray,
    ) -> FloatArray:
        """Return radiant intensities (n,) in a band, W/sr, at the source: without the atmosphere.

        `altitude_m` is height above the WGS 84 ellipsoid; `aspect_rad` is the angle, in [0, pi],
        that `aspect_rad()` gives, or that between the direction of flight and the direction to the
        sensor: 0 is nose-on, pi/2 broadside. In a dark gap between burns the engine asks for a time
        just after burnout.
        """

    def intensities_w_sr(
        self,
        bands: Sequence[int],
        target: IndexArray,
        time_since_ignition_s: FloatArray,
        altitude_m: FloatArray,
        aspect_rad: FloatArray,
    ) -> FloatArray:
        """Return those of several bands (bands, n); to define where all at once cost less than one
        after the other.
        """
        columns = (target, time_since_ignition_s, altitude_m, aspect_rad)
        return _stacked([self.intensity_w_sr(band, *columns) for band in bands])

    def aspect_rad(
        self, target: IndexArray, time_s: FloatArray, to_sensor_ecef: FloatArray
    ) -> FloatArray | None:
        """Return the angles (n,) that `intensity_w_sr` takes at scene times, by unit vectors (n, 3)
        to the sensors.

        None where that angle is measured from the direction of flight (of the velocity in ECEF), as
        for plumes.
        """
        return None

    @optional
    def time_breakpoints_s(self) -> FloatArray | None:
        """Times since ignition (targets, k) at which intensities jump or bend, s; nan where there
        are fewer.
        """
        return None

    @optional
    def altitude_breakpoints_m(self) -> FloatArray | None:
        """Altitudes (targets, k) at which they do while the plume burns, m; nan where there are
        fewer.
        """
        return None

    def reflecting_area_m2(
        self, target: IndexArray, time_since_ignition_s: FloatArray
    ) -> FloatArray:
        """Return albedo times cross-section (n,), m², of diffuse spheres; 0 where no sunlight is
        reflected.

        The engine adds the reflected light. Only targets that sensors follow after burnout reflect.
        """
        return np.zeros(len(target))

    @optional
    def heated_below_m(self) -> float:
        """Altitude below which the engine asks for `air_heated_w_sr`, m; never by default."""
        return -math.inf

    def air_heated_w_sr(
        self,
        bands: Sequence[int],
        target: IndexArray,
        altitude_m: FloatArray,
        speed_m_s: FloatArray,
    ) -> FloatArray:
        """Return what bodies radiate more (bands, n), W/sr, since the air heats them; 0 by default.

        The engine adds it for targets that sensors look at after burnout or in dark gaps;
        `speed_m_s` (n,) is relative to the air, which turns with the Earth.
        """
        return np.zeros((len(bands), len(target)))


class Sources(PluginPart):
    """Emitters other than targets, made by one block of a scene's `sources`: fires, aircraft,
    lightning.

    The engine adds them to the targets as further rows; `trajectories.type_code` are codes into
    `opir_core.plugin.EMITTER_TYPES` of the types that they resemble, `trajectories.class_names`
    their own kinds, where these have other names; `trajectories.ignition_s` and `burnout_s` say
    when they shine, which may begin before the scene does.

    >>> class NoFires(Sources):
    ...     ids = ()
    ...     trajectories = signatures = None
    >>> len(NoFires().ids)
    0
    """

    @required
    def ids(self) -> Sequence[str]:
        """Ids of the emitters, required: the block's own id with a number from 1, `fires-17`."""

    @required
    def trajectories(self) -> Trajectories:
        """Their positions and times; required."""

    @required
    def signatures(self) -> Signatures:
        """Their signatures; required."""


class Transmittance(PluginPart):
    """The transmittance of the atmosphere; by default without clouds.

    >>> class Haze(Transmittance):
    ...     def transmittance(self, band, path):
    ...         return np.full(len(path), 0.8)
    >>> Haze().cloud_top_m(np.zeros((1, 3)))
    array([-inf])
    """

    @abstractmethod
    def transmittance(self, band: int, path: Paths) -> FloatArray:
        """Return in-band transmittances (n,) in [0, 1] from target to sensor; 1 for targets above
        the atmosphere.
        """

    def transmittances(self, bands: Sequence[int], path: Paths) -> FloatArray:
        """Return those of several bands (bands, n); to define where all at once cost less than one
        after the other.
        """
        return _stacked([self.transmittance(band, path) for band in bands])

    def cloud_top_m(self, point_ecef_m: FloatArray) -> FloatArray:
        """Return the heights (n,) of the tops of opaque clouds over points (n, 3), m; -inf where
        there is none.
        """
        return np.full(len(point_ecef_m), -np.inf)

    @optional
    def uses_seed(self) -> bool:
        """Whether the built atmosphere depends on the scene's seed; replicates of a run share one
        that does not.
        """
        return True

    @optional
    def clear(self) -> "Transmittance":
        """The same air without its clouds."""
        return self

    @optional
    def altitude_breakpoints_m(self) -> FloatArray:
        """Altitudes (k,) of targets at which the transmittance jumps or bends, m."""
        return np.empty(0)


@frozen
class Structure:
    """The power spectrum of a background's structure: flat up to 1/`scale_m`, then falling as
    k^-`exponent`.
    """

    scale_m: float
    exponent: float


class Background(PluginPart):
    """The radiance behind a target.

    With `structures` and `structured_radiances_w_m2_sr` sensors with a focal plane see its
    structure as clutter.

    >>> class Grey(Background):
    ...     def radiance_w_m2_sr(self, band, view):
    ...         return np.full(len(view), 0.1)
    ...
    ...     def clutter_w_m2_sr(self, band, view):
    ...         return np.full(len(view), 0.01)
    >>> Grey().radiances_and_clutter_w_m2_sr([0], range(1))
    (array([[0.1]]), array([[0.01]]))
    """

    @abstractmethod
    def radiance_w_m2_sr(self, band: int, view: Views) -> FloatArray:
        """Return in-band radiances (n,) at the sensor, W m⁻² sr⁻¹; 0 for cold space."""

    @abstractmethod
    def clutter_w_m2_sr(self, band: int, view: Views) -> FloatArray:
        """Return the standard deviations (n,) of the radiance left after the subtraction of the
        background.

        Over a pixel of solid angle ω at range R it equals a source of standard deviation clutter ·
        ω · R², W/sr, or an irradiance of clutter · ω at the aperture, W/m².
        """

    def radiances_and_clutter_w_m2_sr(
        self, bands: Sequence[int], view: Views
    ) -> tuple[FloatArray, FloatArray]:
        """Return both of several bands (bands, n); to define where all at once cost less than one
        after the other.
        """
        radiance = [self.radiance_w_m2_sr(band, view) for band in bands]
        return _stacked(radiance), _stacked([self.clutter_w_m2_sr(band, view) for band in bands])

    @optional
    def structures(self) -> Sequence[Structure]:
        """The structures of its parts: cloud, ground, limb."""
        return ()

    def structured_radiances_w_m2_sr(
        self, bands: Sequence[int], view: Views
    ) -> tuple[FloatArray, FloatArray, IndexArray]:
        """Return radiances and the standard deviations of their structure (bands, n), and its
        number (n,) among `structures`.

        A background with `structures` must define it; `ModelError` without it.
        """
        raise undefined(self, "structured_radiances_w_m2_sr", "structures")


@frozen(kw_only=True)
class SignatureContext:
    """What a signature model is built with, row by row with its configurations.

    `paths` are the scene paths of the targets; `types` their target classes; `profiles` the class
    profile of each, as the target model's `truth` names it, or "" where it names none;
    `burn_time_s` (n,) from ignition to burnout; `plumes` the default plumes of classes and
    profiles, or () for those of the core's classes. `burns_s` (n, k, 2) are ignition and burnout of
    each burn since the first ignition, nan where a target has fewer.
    """

    bands: tuple[Band, ...]
    ids: tuple[str, ...]
    paths: tuple[str, ...]
    types: tuple[str, ...]
    profiles: tuple[str, ...]
    burn_time_s: FloatArray = field(eq=False)
    plumes: tuple[Plume, ...] = ()
    burns_s: FloatArray = field(
        eq=False,
        default=Factory(
            lambda context: one_burn_s(np.zeros(len(context.burn_time_s)), context.burn_time_s),
            takes_self=True,
        ),
    )


@frozen(kw_only=True)
class SourceContext:
    """What a source model is built with: the block's id and scene path, and the scene's bands,
    epoch, length, seed.

    `make_atmosphere` returns the scene's atmosphere, through which sunlight comes down to what
    mirrors it; without it that light is whole. `launched` returns the trajectories of the scene's
    launch with an id, and its row there; it raises `ModelError` for an unknown one.
    """

    bands: tuple[Band, ...]
    id: str
    path: str
    epoch_us: int
    duration_s: float
    seed: int
    make_atmosphere: Callable[[], Transmittance] | None = None
    launched: "Callable[[str], tuple[Trajectories, int]] | None" = None


@frozen(kw_only=True)
class AtmosphereContext:
    """What an atmosphere model is built with."""

    bands: tuple[Band, ...]
    path: str
    seed: int


@frozen(kw_only=True)
class BackgroundContext:
    """What a background model is built with; `make_atmosphere` returns the scene's, whose clouds it
    may look at.
    """

    bands: tuple[Band, ...]
    path: str
    epoch_us: int
    make_atmosphere: Callable[[], Transmittance]


def _stacked(columns: Sequence[FloatArray]) -> FloatArray:
    """Return columns (n,) of bands as (bands, n); one object for each that has no shape in common
    with the others.
    """
    return np.array(columns, dtype=None if len(set(map(np.shape, columns))) <= 1 else object)
