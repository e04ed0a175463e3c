"""The settings that a scene sets and nothing in it reads."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from attrs import field, frozen, has

from opir_core.host.components import (
    AtmosphereModel,
    ClassifierModel,
    Component,
    ConfidenceModel,
    DetectionModel,
    SensorModel,
    TrackerModel,
)
from opir_core.host.host import Host
from opir_core.scene.fields import DRAG, READ_BY, field_infos
from opir_core.scene.scene import BY_REPORT, Choice, Scene

#: The kinds of components that read settings of others; one that does not declare what it reads may
#: read all of them.
_READERS = (
    SensorModel,
    DetectionModel,
    ClassifierModel,
    ConfidenceModel,
    TrackerModel,
    AtmosphereModel,
)

#: The number of an item in a path.
_INDEX = re.compile(r"\[\d+\]")


@frozen
class UnreadSetting:
    """A setting that nothing reads: its path in the scene, its place in the file ("" if unknown),
    and the reason.
    """

    path: str
    reason: str
    place: str = field(default="", eq=False)


def unread_settings(scene: Scene, host: Host) -> list[UnreadSetting]:
    """Return the settings that the scene's file sets and nothing reads, each once."""
    names = {(choice.hook, choice.name) for choice in scene.choices}
    components = {(hook, name): host.component(hook, name) for hook, name in names}
    subjects = _subjects_read(scene, components)
    settings: dict[UnreadSetting, None] = {}
    for choice in scene.choices:
        if choice.written:
            settings |= dict.fromkeys(
                _unread(choice, components[choice.hook, choice.name], subjects)
            )
    return [*settings, *_unread_keys(scene, components)]


def unread_texts(settings: Iterable[UnreadSetting]) -> list[str]:
    """Return a warning for each setting, one for those of the items of a list together."""
    grouped: dict[tuple[str, str], list[UnreadSetting]] = {}
    for setting in settings:
        grouped.setdefault((_INDEX.sub("[*]", setting.path), setting.reason), []).append(setting)
    return [_text(*group) for group in grouped.values()]


def _text(setting: UnreadSetting, *settings: UnreadSetting) -> str:
    more = f" and {len(settings)} more like it" if settings else ""
    place = f" ({setting.place})" if setting.place else ""
    return f"{setting.path}{more}: nothing in this scene reads it: {setting.reason}{place}"


def _subjects_read(
    scene: Scene, components: Mapping[tuple[str, str], Component]
) -> frozenset[str] | None:
    """Return the subjects that the scene's components read; None if one of them may read any."""
    hooks = {kind.hook for kind in _READERS}
    subjects: set[str] = {DRAG} if scene.forces.drag is not None else set[str]()
    for choice in scene.choices:
        read = components[choice.hook, choice.name].subjects_read(choice.config)
        if read is None and choice.hook in hooks:
            return None
        subjects.update(read or ())
    return frozenset(subjects)


def _unread(
    choice: Choice, component: Component, subjects: frozenset[str] | None
) -> Iterator[UnreadSetting]:
    """Yield the settings of a component's block that no component reads, or the whole block."""
    if not _is_read(component.described, subjects):
        yield UnreadSetting(choice.path, _reason(component.described), choice.written[""])
        return
    for path, place in choice.written.items():
        depth, reason = _reason_of_setting(choice.config, path.split("."), subjects)
        if reason:
            yield UnreadSetting(".".join([choice.path, *path.split(".")[:depth]]), reason, place)


def _reason_of_setting(
    config: Any, keys: Sequence[str], subjects: frozenset[str] | None
) -> tuple[int, str]:
    """Return how many of nested keys lead to a setting that is not read, and why; "" if all are."""
    for depth, key in enumerate(keys, 1):
        info = field_infos(type(config)).get(key) if has(type(config)) else None
        if info is None:
            break
        if not _is_read(info.subject, subjects):
            return depth, _reason(info.subject)
        if info.read_if is not None and not info.read_if[1](config):
            return depth, f"it is read {info.read_if[0]}"
        config = getattr(config, key)
    return len(keys), ""


def _is_read(subject: str, subjects: frozenset[str] | None) -> bool:
    return not subject or subjects is None or subject in subjects


def _reason(subject: str) -> str:
    """Return the components that read a subject, in words."""
    return READ_BY.get(subject, f"no component of it reads {subject}")


def _unread_keys(
    scene: Scene, components: Mapping[tuple[str, str], Component]
) -> Iterator[UnreadSetting]:
    """Yield the keys of the scene itself that nothing reads."""
    preset = scene.written.get("preset")
    is_tracked = scene.tracker.name != "none"
    if preset is not None and not any(
        preset in component.presets for component in components.values()
    ):
        yield UnreadSetting("preset", f"no component has the preset {preset}")
    if "tracking_order" in scene.written and not is_tracked:
        yield UnreadSetting("tracking_order", "a tracker does")
    if "tracking_lag_s" in scene.written and not (is_tracked and scene.tracking_order == BY_REPORT):
        yield UnreadSetting("tracking_lag_s", f"a tracker does, with tracking_order: {BY_REPORT}")
