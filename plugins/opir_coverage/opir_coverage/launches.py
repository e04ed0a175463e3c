"""Launches of one class from every cell of a grid, and the models that see them: the engine's own, in columns."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from attrs import evolve, frozen

from opir_core import Plan
from opir_core.arrays import FloatArray, IndexArray
from opir_core.errors import ModelError
from opir_core.flight import BoostPath, ascent, boost_path, launch_site
from opir_core.interfaces import Surroundings
from opir_core.planning import Targets, join_targets
from opir_core.plugin import BoostProfile, DetectionProbability, ModelContext, TargetClass, TargetModel, Trajectories
from opir_core.scene import Choice
from opir_coverage.grid import PlaceGrid

_ID = "launch"


@frozen(eq=False)
class LaunchPlaces:
    """Launch places (n,), rad, and the class, the profile and the azimuth, rad, of the launches from them."""

    latitude_rad: FloatArray
    longitude_rad: FloatArray
    target_class: TargetClass
    profile: BoostProfile
    azimuth_rad: float

    @classmethod
    def of(cls, grid: PlaceGrid, kind: TargetClass, azimuth_rad: float, profile: str = "") -> "LaunchPlaces":
        """Return launches from the cells of a grid, of the class's first profile or one by name."""
        known = {each.name: each for each in kind.profiles}
        chosen = known.get(profile) if profile else kind.profiles[0]
        if chosen is None:
            raise ValueError(f"{kind.name} has no profile {profile!r}; it has {', '.join(known)}")
        return cls(*grid.places_rad(), kind, chosen, azimuth_rad)

    def __len__(self) -> int:
        return len(self.latitude_rad)

    def path(self, ignition_s: float, *, speed_m_s: float = 0.0, angle_rad: float = 0.0) -> BoostPath:
        """Return the boosts of launches at a scene time, with offsets of burnout speed and flight path angle."""
        one = np.ones(len(self))
        course = ascent([self.profile] * len(self), self.profile.burnout_flight_path_angle_rad * one + angle_rad)
        site = launch_site(self.latitude_rad, self.longitude_rad, 0.0 * one)
        speed = (self.profile.burnout_speed_m_s + speed_m_s) * one
        return boost_path(site, ignition_s, self.azimuth_rad * one, speed, course)


class GridLaunches(Trajectories):
    """The boosts of launches from a grid, as trajectories."""

    def __init__(self, places: LaunchPlaces, path: BoostPath) -> None:
        self.type_code = np.full(len(places), places.target_class.type_code, dtype=np.uint8)
        self.ignition_s, self.burnout_s = path.ignition_s, path.burnout_s
        self.class_names = [places.target_class.name] * len(places)
        self._path, self._profile = path, places.profile.name

    def position_ecef_m(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) of launches (n,) at scene times (n,)."""
        return self._path.state(target, time_s)[0]

    def truth(self) -> Sequence[Mapping[str, Any]]:
        """Return the profile of each launch."""
        return [{"id": _ID, "profile": self._profile}] * len(self.type_code)


@frozen
class _Launch:
    """What models of light read of a scene's target: here one for all launches."""

    model: Choice
    id: str = _ID
    signature: None = None


def detection_of(plan: Plan, launches: GridLaunches) -> tuple[DetectionProbability, Targets]:
    """Return a scene's detection model for launches from a grid, and these as targets."""
    count = len(launches.type_code)
    targets = join_targets([_ID] * count, [launches], [range(count)])
    model = Choice(TargetModel.hook, "ballistic", None, "--class")
    scene = evolve(plan.scene, targets=(_Launch(model),), sources=())
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
    """Return a target class by name; raises `ModelError` for one that nothing offers."""
    known = plan.host.names(TargetClass.hook)
    if name not in known:
        raise ModelError(f"--class: {name!r} is not one of {', '.join(sorted(known))}")
    return plan.host.component(TargetClass, name)
