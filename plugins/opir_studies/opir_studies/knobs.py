"""The settings that trade accuracy for run time: for each its levels, from the most exact to the
coarsest.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from attrs import frozen

from opir_core import Scene
from opir_core.reading import scene_mapping

#: Overrides as `--set` takes them.
Overrides = tuple[str, ...]


@frozen
class Knob:
    """A setting with its levels, most exact first; each level is a set of overrides, empty for what
    the scene has.

    `p_d` are the errors of P_d that the levels allow by their own definition, if the setting is a
    tolerance of it.
    """

    name: str
    levels: tuple[Overrides, ...]
    p_d: tuple[float, ...] = ()

    def allows(self, level: int, errors: Mapping[str, float]) -> bool:
        """Whether a level is within the errors by its own definition: one scene
        could flatter it.
        """
        return not self.p_d or self.p_d[level] <= errors.get("p_d", math.inf)


def knobs_of(scene: Scene) -> list[Knob]:
    """Return the knobs that apply to a scene: only of components and forces that it names."""
    plain = scene_mapping(scene)
    return [knob for make in _MAKERS for knob in make(scene, plain)]


def _probability(scene: Scene, _plain: Mapping[str, Any]) -> Iterator[Knob]:
    if scene.detection.name == "snr":
        tolerances = ("1.0e-6", "1.0e-5", "1.0e-4", "1.0e-3", "1.0e-2", "1.0e-1")
        tolerant = (
            (f"detection.probability_tolerance={tolerance}", "detection.exact=false")
            for tolerance in tolerances
        )
        yield Knob(
            "probability tolerance",
            (("detection.exact=true",), *tolerant),
            (0.0, *map(float, tolerances)),
        )


def _light_time(scene: Scene, _plain: Mapping[str, Any]) -> Iterator[Knob]:
    if scene.light_time:
        yield Knob("light time", ((), ("light_time=false",)))


def _forces(scene: Scene, plain: Mapping[str, Any]) -> Iterator[Knob]:
    """Leave out drag, then zonal terms from the highest down; a scene of two-body motion has
    nothing to leave out.
    """
    named = plain.get("forces")
    if not isinstance(named, list):
        return
    drag = [term for term in named if isinstance(term, dict) or term == "drag"]
    zonal = [term for term in named if term not in drag]
    fewer = [zonal[:count] for count in range(len(zonal) - (not drag), 0, -1)]
    levels = [json.dumps(term) for term in fewer]
    yield Knob("forces", ((), *((f"forces={level}",) for level in levels), ("forces=kepler",)))


def _classifier(scene: Scene, _plain: Mapping[str, Any]) -> Iterator[Knob]:
    if scene.classification.name == "spectral":
        yield Knob(
            "launches of the classifier",
            tuple((f"classification.launches={n}",) for n in (240, 60, 24, 8)),
        )


def _tracker(scene: Scene, _plain: Mapping[str, Any]) -> Iterator[Knob]:
    """Cadence and slice together, since a slice is at most the cadence; the exact level has
    quarters of a second.
    """
    if scene.tracker.name == "imm":
        pairs = (("1.0", "0.25"), ("1.0", "1.0"), ("2.0", "2.0"), ("5.0", "5.0"), ("10.0", "10.0"))
        yield Knob(
            "tracker cadence and slice",
            tuple(
                (f"tracker.cadence_s={cadence}", f"tracker.slice_s={slice_}")
                for cadence, slice_ in pairs
            ),
        )
        if scene.tracker.config.forecast.name == "regions":
            yield Knob(
                "impact regions",
                tuple(
                    (f"tracker.forecast={{model: regions, renewal_share: {share}}}",)
                    for share in ("0.05", "0.2", "0.5")
                ),
            )
    elif scene.tracker.name == "kepler-arc":
        yield Knob(
            "tracker cadence",
            tuple((f"tracker.cadence_s={s}",) for s in ("1.0", "2.0", "5.0", "10.0")),
        )


_MAKERS: tuple[Callable[[Scene, Mapping[str, Any]], Iterator[Knob]], ...] = (
    _probability,
    _light_time,
    _forces,
    _classifier,
    _tracker,
)
