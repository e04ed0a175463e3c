"""The types that a scene's events report, and the four types of the paper that trackers know."""

from collections.abc import Iterable, Mapping
from contextlib import suppress

import numpy as np
from attrs import evolve

from opir_core.arrays import ByteArray
from opir_core.errors import ModelError, PluginError
from opir_core.host.host import Host
from opir_core.interfaces.sensors import Sensor
from opir_core.scene.fields import CONFUSION
from opir_core.scene.hypotheses import Hypothesis, hypotheses_of
from opir_core.scene.scene import PAPER_TYPES, REPORTED_TYPES, Choice, Scene
from opir_core.scene.target_classes import TargetClass

#: Codes of reported types are bytes.
_MOST_TYPES = 256


def reported_types(scene: Scene, host: Host) -> tuple[str, ...]:
    """Return the names of the types that a scene's events may report: `REPORTED_TYPES`, then finer
    classes by name.

    The classes are all that are offered, for a running scene may launch others than it began with.
    """
    if scene.reported_types == PAPER_TYPES:
        return REPORTED_TYPES
    names = (
        *REPORTED_TYPES,
        *(name for name in host.names(TargetClass) if name not in REPORTED_TYPES),
    )
    if len(names) > _MOST_TYPES:
        raise ModelError(
            f"reported_types: there are {len(names)} types; at most {_MOST_TYPES} can be reported"
        )
    return names


def offered_hypotheses(host: Host) -> tuple[Hypothesis, ...]:
    """Return the hypotheses of the target classes that are offered, without those that fail to
    load.

    Whoever names such a class in a scene gets the error.
    """
    classes = []
    for name in host.names(TargetClass):
        with suppress(PluginError):
            classes.append(host.component(TargetClass, name))
    return hypotheses_of(classes)


def paper_codes(names: Iterable[str], host: Host) -> ByteArray:
    """Return the codes (n,) into `REPORTED_TYPES` of the types that stand for reported types, class
    by class.
    """
    return np.array(
        [REPORTED_TYPES.index(_paper_type(name, host)) for name in names], dtype=np.uint8
    )


def sensors_of_trackers(
    sensors: Iterable[Sensor], classification: Choice, host: Host
) -> tuple[Sensor, ...]:
    """Return the sensors as trackers know them: a confusion matrix has columns for `REPORTED_TYPES`
    only, to which classes add. Where a sensor with a narrow field looks, they do not know: its
    silence says nothing.

    Where the classifier does not report by these matrices, they say nothing of its reports: the
    sensors have none.
    """
    sensors = [evolve(each, watched_s=()) if each.is_narrow else each for each in sensors]
    classifier = host.component(classification.hook, classification.name)
    subjects = classifier.subjects_read(classification.config)
    if subjects is not None and CONFUSION not in subjects:
        return tuple(evolve(sensor, confusion={}) for sensor in sensors)
    return tuple(_with_paper_types(sensor, host) for sensor in sensors)


def _with_paper_types(sensor: Sensor, host: Host) -> Sensor:
    if all(name in REPORTED_TYPES for row in sensor.confusion.values() for name in row):
        return sensor
    return evolve(
        sensor, confusion={true: _paper_row(row, host) for true, row in sensor.confusion.items()}
    )


def _paper_row(row: Mapping[str, float], host: Host) -> Mapping[str, float]:
    summed: dict[str, float] = {}
    for name, probability in row.items():
        kind = _paper_type(name, host)
        summed[kind] = summed.get(kind, 0.0) + probability
    return summed


def _paper_type(name: str, host: Host) -> str:
    return name if name in REPORTED_TYPES else host.component(TargetClass, name).reported_type
