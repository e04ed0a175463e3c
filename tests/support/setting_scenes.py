"""Small scenes in which settings are or are not read, and what a run of one writes."""

import hashlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from attrs import fields, has
from other_values import nested, other_values

import opir_core as opir
from opir_core.errors import OpirError
from opir_core.host.host import Host
from opir_core.reading.component_reader import conditional_fields
from opir_core.simulation.unread_settings import unread_settings

SENSOR: dict[str, Any] = {
    "model": "SBIRS-GEO",
    "id": "S",
    "orbital_slot_deg": -130.0,
    "scan_period_ms": 500.0,
}
TARGET: dict[str, Any] = {
    "id": "T",
    "type": "SRBM",
    "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 1.0},
    "aim": {"lat_deg": 32.0, "lon_deg": -124.0},
}
FAR = {**TARGET, "type": "ICBM", "aim": {"lat_deg": 9.0, "lon_deg": 167.7}}
PLUME = {"signature": {"model": "plume"}}
HOT = {
    **TARGET,
    "signature": {"model": "plume", "body_temperature_k": 3000.0, "body_area_m2": 40.0},
}
BRIGHT = {**FAR, "signature": {"model": "plume", "scale": 100.0}}
#: Near the threshold: who knows the true type shows what the threshold does by detections alone.
FAINT = {**TARGET, "signature": {"model": "plume", "scale": 1e-2}}
LIGHT: dict[str, Any] = {"detection": {"model": "snr"}, "targets": [{**TARGET, **PLUME}]}
SKY: dict[str, Any] = {
    **LIGHT,
    "atmosphere": {"model": "lowtran"},
    "background": {"model": "earth"},
}
RATIOS = {**SENSOR, "spectral_discrimination": "dual-band-ratio"}
PLAIN = {**SENSOR, "focal_plane": None, "nei_w_m2": 1e-13}
FOLLOWING = {**SENSOR, "follows_bodies": True}
ALIGNED = {**SENSOR, "scan_phase": "aligned"}
SINGLE = {**SENSOR, "focal_plane": {"temporal_filter": "none", "dark_current_e_s": 1e5}}
SPINNING = {**SENSOR, "scan_pattern": "spin"}
DRAG: dict[str, Any] = {"forces": [{"drag": {}}]}
DECK = {"model": "lowtran", "cloud": {"top_km": 2.0}}
PART = {"model": "lowtran", "cloud": {"top_km": 2.0, "cover": 0.5}}

#: Changes of the plain scene, by name.
SCENES: Mapping[str, Mapping[str, Any]] = {
    "constant": {"tracker": {"model": "imm"}},
    "constant, beside light": {**SKY, "detection": {"model": "constant"}, "atmosphere": DECK},
    "aligned": {"sensors": [ALIGNED]},
    "spin": {"sensors": [SPINNING]},
    "drag": {**DRAG, "sensors": [FOLLOWING], "duration_s": 120.0},
    "light": LIGHT,
    "sky": SKY,
    "single frames": {**SKY, "sensors": [SINGLE]},
    "deck": {**SKY, "atmosphere": DECK},
    "cells": {
        **SKY,
        "atmosphere": PART,
        "background": {"model": "earth", "structure": {"surface": "sea"}},
    },
    "ratios": {**SKY, "sensors": [RATIOS]},
    "no plane": {**SKY, "sensors": [PLAIN]},
    "bodies": {**SKY, "targets": [HOT], "sensors": [FOLLOWING], "duration_s": 120.0},
    "calibrated": {"targets": [BRIGHT], "detection": {"model": "snr", "calibrate": "paper"}},
    "exact": {**LIGHT, "detection": {"model": "snr", "exact": True}},
    "coasts alone": {"tracker": {"model": "imm", "modes": "coast"}},
    "boosts alone": {"tracker": {"model": "imm", "modes": "boost"}},
    "kepler-arc": {"tracker": {"model": "kepler-arc"}},
    "paper": {**LIGHT, "targets": [FAINT], "classification": {"model": "paper"}},
}

HOST = Host.discover()


def scene_of(name):
    """Return a scene by name, as plain values."""
    plain = {
        "scene": "settings",
        "epoch": "2026-04-01T20:00:00Z",
        "duration_s": 60.0,
        "seed": 3,
        "sensors": [SENSOR],
        "targets": [TARGET],
        "detection": {"model": "constant"},
        "outputs": [],
    }
    return {**plain, **SCENES[name]}


def changed_scenes(name):
    """Yield the path of each setting of the components of a scene that is read under a condition,
    and the scene with another value there. Settings of blocks that the scene does not have are left
    out: they bring the block."""
    scene = scene_of(name)
    changed_scene = opir.scene_from_mapping(scene, host=HOST)
    for choice in changed_scene.choices:
        config_class = HOST.component(choice.hook, choice.name).config
        for key, value in other_values(config_class):
            if key.partition(".")[0] not in conditional_fields(config_class) or _value(
                choice.config, key
            ) in (
                _ABSENT,
                value,
            ):
                continue
            yield f"{choice.path}.{key}", _with(scene, choice.path, choice.name, nested(key, value))


_ABSENT = "no such block"


def _value(config, key):
    """Return the value of a dotted setting, `_ABSENT` if it stands in a block that is not there."""
    for name in key.split("."):
        if config is None:
            return _ABSENT
        config = getattr(config, name)
    return config


def _with(scene, path, model, block):
    """Return a scene with a block merged into the one at a path."""
    head, _, remainder = path.partition("[0]")
    if head in ("sensors", "targets", "sources"):
        (item,) = scene[head]
        inner = remainder.removeprefix(".")
        changed = _merged(item, {inner: {"model": model, **block}} if inner else block)
        return {**scene, head: [changed]}
    return {**scene, head: _merged({"model": model, **scene.get(head, {})}, block)}


def _merged(block, over):
    merged = dict(block)
    for key, value in over.items():
        old = merged.get(key)
        merged[key] = (
            _merged(old, value)
            if isinstance(old, Mapping) and isinstance(value, Mapping)
            else value
        )
    return merged


def unread_paths(scene):
    """Return the paths of what nothing reads; None if the scene is refused."""
    try:
        return {
            unread_setting.path
            for unread_setting in unread_settings(opir.scene_from_mapping(scene, host=HOST), HOST)
        }
    except OpirError:
        return None


def is_named(path, unread):
    """Return whether a setting, or a block that it stands in, is among unread ones."""
    return any(path == name or path.startswith(f"{name}.") for name in unread)


def digest(scene):
    """Return the hash of all that a run of a scene writes; the text of the error if it cannot
    run.
    """
    try:
        run = opir.simulate(opir.scene_from_mapping(scene, host=HOST), HOST)
    except OpirError as error:
        return str(error)
    total = hashlib.sha256()
    for record in (run.detections, run.truth, run.tracks, run.estimates):
        for value in _parts(record):
            total.update(value)
    return total.hexdigest()


def _parts(value):
    """Yield the bytes of the arrays, numbers and texts in a record."""
    if isinstance(value, np.ndarray) and value.dtype.hasobject:
        yield from _parts(value.ravel().tolist())
    elif isinstance(value, np.ndarray):
        yield value.tobytes()
    elif has(type(value)):
        for attribute in fields(type(value)):
            yield from _parts(getattr(value, attribute.name))
    elif isinstance(value, tuple | list):
        for item in value:
            yield from _parts(item)
    elif value is None or isinstance(value, str | int | float):
        yield repr(value).encode()
    else:
        raise TypeError(f"{type(value)} has no bytes")
