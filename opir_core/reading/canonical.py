"""A scene's canonical form and its hash, for manifests, so that a run can be repeated."""

import json
from collections.abc import Mapping
from hashlib import sha256
from itertools import groupby
from typing import Any

from attrs import fields, fields_dict, has

from opir_core.reading.scene_schema import CHOICES, text_of_epoch_us
from opir_core.scene.fields import alternatives
from opir_core.scene.scene import PAPER_TYPES, Choice, Scene, SceneSensor, SceneTarget, WorkLimits


def scene_mapping(scene: Scene) -> dict[str, Any]:
    """Return a scene as plain data with every setting written out, defaults, presets and
    constellations included.

    `scene_from_mapping(scene_mapping(scene)) == scene` for every scene that was read.
    """
    drag = [] if scene.forces.drag is None else [{"drag": _settings(scene.forces.drag)}]
    return {
        "scene": scene.name,
        "epoch": text_of_epoch_us(scene.epoch_us),
        "duration_s": scene.duration_s,
        "seed": scene.seed,
        "light_time": scene.light_time,
        # Only where they are set: the hash of every other scene is independent of these keys.
        **({} if scene.reported_types == PAPER_TYPES else {"reported_types": scene.reported_types}),
        **({} if scene.limits == WorkLimits() else {"limits": _settings(scene.limits)}),
        **({"allow_implausible": True} if scene.allow_implausible else {}),
        **({"watched_s": plain_spans(scene.watched_s)} if scene.watched_s else {}),
        **({} if scene.director is None else {"director": _block(scene.director)}),
        **({"faults": [_set_values(fault) for fault in scene.faults]} if scene.faults else {}),
        **({} if scene.links is None else {"links": _set_values(scene.links)}),
        "forces": ("kepler" if scene.forces.is_kepler else [*scene.forces.zonal, *drag]),
        "sensors": _sensors(scene.sensors),
        "targets": [_target(target) for target in scene.targets],
        "sources": [{"id": source.id, **_block(source.model)} for source in scene.sources],
        **{key: _block(getattr(scene, key)) for key in CHOICES},
        "tracking_order": scene.tracking_order,
        "tracking_lag_s": scene.tracking_lag_s,
        "outputs": [{choice.name: _output_settings(choice)} for choice in scene.outputs],
    }


def plain_spans(
    watched_s: Mapping[str, tuple[tuple[float, float], ...]],
) -> dict[str, list[list[float]]]:
    """Return the spans in which sensors look as plain data."""
    return {sensor: [list(span) for span in spans] for sensor, spans in watched_s.items()}


def scene_hash(scene: Scene) -> str:
    """Return the SHA-256 (hexadecimal) of a scene's canonical form.

    Scenes of equal content have the same hash, independent of spelling, order and comments of their
    files.
    """
    text = json.dumps(
        scene_mapping(scene),
        sort_keys=True,
        separators=(",", ":"),
        ensure_ascii=True,
        allow_nan=False,
    )
    return sha256(text.encode("ascii")).hexdigest()


def _sensors(sensors: tuple[SceneSensor, ...]) -> list[dict[str, Any]]:
    """Return single sensors as they are, and members of a constellation together in the block that
    they came from.
    """
    blocks = []
    for (constellation, _), group in groupby(
        sensors, key=lambda sensor: (sensor.constellation, sensor.model.path)
    ):
        members = [{"id": sensor.id, **_block(sensor.model)} for sensor in group]
        blocks += (
            members
            if constellation is None
            else [{"constellation": constellation, "members": members}]
        )
    return blocks


def _target(target: SceneTarget) -> dict[str, Any]:
    signature = {} if target.signature is None else {"signature": _block(target.signature)}
    return {"id": target.id, **_block(target.model), **signature}


def _block(choice: Choice) -> dict[str, Any]:
    return {"model": choice.name, **_settings(choice.config)}


def _output_settings(choice: Choice) -> dict[str, Any]:
    spool = {} if choice.spool is None else {"spool": _settings(choice.spool)}
    return {**_settings(choice.config), **spool}


def _settings(config: Any) -> dict[str, Any]:
    """Return a configuration's fields; of two alternatives, the one that is set."""
    kind: type = type(config)
    names = [attribute.name for attribute in fields(kind) if attribute.init]
    silent = {pair.plain for pair in alternatives(kind) if getattr(config, pair.other) is not None}
    silent |= {
        name
        for name in getattr(kind, "unwritten", ())
        if getattr(config, name) == fields_dict(kind)[name].default
    }
    return {name: _plain(getattr(config, name)) for name in names if name not in silent}


def _set_values(config: Any) -> dict[str, Any]:
    """Return the settings of a configuration that are set."""
    return {name: value for name, value in _settings(config).items() if value is not None}


def _plain(value: Any) -> Any:
    if isinstance(value, Choice):
        return _block(value)
    if has(type(value)):
        return _settings(value)
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value
