"""Launches of one class from every cell of a grid, and the engine's models for them, in columns."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from attrs import evolve, frozen

from opir_core import Plan
from opir_core.arrays import ByteArray, FloatArray, IndexArray, IntArray, RowArray
from opir_core.errors import ModelError
from opir_core.flight import BoostPath, ascent, boost_path, launch_site
from opir_core.interfaces import Surroundings
from opir_core.planning import Targets, join_targets
from opir_core.plugin import (
    BoostProfile,
    DetectionProbability,
    ModelContext,
    TargetClass,
    TargetModel,
    Trajectories,
)
from opir_core.scene import Choice
from opir_coverage.grid import PlaceGrid

_ID = "launch"


@frozen(eq=False)
class LaunchPlaces:
    """Launch places (n,), rad, with class, profile and azimuth, rad, of their launches."""

    latitude_rad: FloatArray
    longitude_rad: FloatArray
    target_class: TargetClass
    profile: BoostProfile
    azimuth_rad: float

    @classmethod
    def of(
        cls, grid: PlaceGrid, kind: TargetClass, azimuth_rad: float, profile: str = ""
    ) -> "LaunchPlaces":
        """Return launches from the cells of a grid, of the class's first profile or one by name."""
        profiles = {candidate.name: candidate for candidate in kind.profiles}
        selected = profiles.get(profile) if profile else kind.profiles[0]
        if selected is None:
            raise ValueError(
                f"{kind.name} has no profile {profile!r}; it has {', '.join(profiles)}"
            )
        return cls(*grid.places_rad(), kind, selected, azimuth_rad)

    def __len__(self) -> int:
        return len(self.latitude_rad)

    def path(
        self, ignition_s: float, *, speed_m_s: float = 0.0, angle_rad: float = 0.0
    ) -> "GridBoosts":
        """Return the boosts of launches at a scene time, with offsets of the burnout state."""
        latitude, row = np.unique(self.latitude_rad, return_inverse=True)
        unit = np.ones(len(latitude))
        angle = self.profile.burnout_flight_path_angle_rad + angle_rad
        course = ascent([self.profile] * len(latitude), angle * unit)
        site = launch_site(latitude, 0.0 * unit, 0.0 * unit)
        speed = (self.profile.burnout_speed_m_s + speed_m_s) * unit
        path = boost_path(site, ignition_s, self.azimuth_rad * unit, speed, course)
        return GridBoosts(path, row, np.cos(self.longitude_rad), np.sin(self.longitude_rad))


@frozen(eq=False)
class GridBoosts:
    """Boosts (n,): the one of `path` at their latitude, turned to their longitude."""

    path: BoostPath
    row: IntArray
    cosine: FloatArray
    sine: FloatArray

    def __len__(self) -> int:
        return len(self.row)

    @property
    def ignition_s(self) -> float:
        """The scene time of all launches."""
        return float(self.path.ignition_s[0])

    @property
    def burnout_s(self) -> float:
        """The scene time of all burnouts."""
        return float(self.path.burnout_s[0])

    @property
    def launch_m(self) -> FloatArray:
        """The launch points (n, 3), ECEF, m."""
        return self._turned(self.path.plane.launch_m[self.row], np.arange(len(self)))

    def state(
        self, target: RowArray | IndexArray, time_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return ECEF positions and velocities (m, 3) of launches (m,) at times (m,), or nan."""
        (position, velocity), rows = self._of_latitudes(target, time_s)
        return self._turned(position, target, rows), self._turned(velocity, target, rows)

    def position_m(self, target: RowArray | IndexArray, time_s: FloatArray) -> FloatArray:
        """Return ECEF positions (m, 3) of launches (m,) at times (m,); nan outside the burn."""
        (position, _), rows = self._of_latitudes(target, time_s)
        return self._turned(position, target, rows)

    def _of_latitudes(
        self, target: RowArray | IndexArray, time_s: FloatArray
    ) -> tuple[tuple[FloatArray, FloatArray], RowArray]:
        """Return states at the longitude 0, and the rows (m,) of launches in them.

        Looks come in runs of equal times: states of all latitudes at these are fewer than those of
        all launches.
        """
        starts = np.flatnonzero(np.diff(time_s, prepend=np.nan) != 0.0)
        latitudes = len(self.path.ignition_s)
        rows = self.row[target]
        if latitudes * len(starts) >= len(rows):
            return self.path.state(rows, time_s), np.arange(len(rows))
        run = np.repeat(np.arange(len(starts)) * latitudes, np.diff(starts, append=len(rows)))
        everyone = np.tile(np.arange(latitudes), len(starts))
        return self.path.state(everyone, np.repeat(time_s[starts], latitudes)), run + rows

    def _turned(
        self, vector_m: FloatArray, target: RowArray | IndexArray, rows: RowArray | None = None
    ) -> FloatArray:
        """Return vectors, or their `rows`, turned to the longitudes of launches (m,)."""
        x, y, z = (column if rows is None else column[rows] for column in vector_m.T)
        cosine = self.cosine[target]
        sine = self.sine[target]
        turned = np.empty((len(target), 3))
        np.subtract(cosine * x, sine * y, out=turned[:, 0])
        np.add(sine * x, cosine * y, out=turned[:, 1])
        turned[:, 2] = z
        return turned


@frozen(eq=False)
class GridLaunches(Trajectories):
    """The boosts of launches from a grid, as trajectories."""

    type_code: ByteArray
    ignition_s: FloatArray
    burnout_s: FloatArray
    class_names: Sequence[str]
    path: GridBoosts
    profile: str

    @classmethod
    def of(cls, places: LaunchPlaces, path: GridBoosts) -> "GridLaunches":
        """Return the launches from places on their paths."""
        code = np.full(len(places), places.target_class.type_code, dtype=np.uint8)
        times_s = np.full(len(places), path.ignition_s), np.full(len(places), path.burnout_s)
        return cls(
            code, *times_s, [places.target_class.name] * len(places), path, places.profile.name
        )

    def position_ecef_m(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) of launches (n,) at scene times (n,)."""
        return self.path.position_m(target, time_s)

    def truth(self) -> Sequence[Mapping[str, Any]]:
        """Return the profile of each launch."""
        return [{"id": _ID, "profile": self.profile}] * len(self.type_code)


@frozen
class _Launch:
    """The fields of a scene's target that models of light read; one for all launches."""

    model: Choice
    id: str = _ID
    signature: None = None


def detection_of(plan: Plan, launches: Trajectories) -> tuple[DetectionProbability, Targets]:
    """Return a scene's detection model for launches from a grid, and these as targets."""
    count = len(launches.type_code)
    targets = join_targets([_ID] * count, [launches], [range(count)])
    model = Choice(TargetModel.hook, "ballistic", None, "--class")
    launch: Any = _Launch(model)
    scene = evolve(plan.scene, targets=(launch,), sources=())
    context = ModelContext(
        sensors=plan.sensors,
        target_type_code=targets.type_code,
        class_names=targets.class_names,
        target_class=partial(plan.host.component, TargetClass),
        reported_types=plan.reported_types,
        hypotheses=plan.hypotheses,
        surroundings=Surroundings(scene, plan.host, plan.sensors, targets, ()),
    )
    choice = plan.scene.detection
    component = plan.host.component(choice.hook, choice.name, choice.path)
    return DetectionProbability.adopt(component.build(choice.config, context)), targets


def target_class_of(plan: Plan, name: str) -> TargetClass:
    """Return a target class by name; raises `ModelError` for an unknown one."""
    names = plan.host.names(TargetClass.hook)
    if name not in names:
        raise ModelError(f"--class: {name!r} is not one of {', '.join(sorted(names))}")
    return plan.host.component(TargetClass, name)
