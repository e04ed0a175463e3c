"""Files that are scored together are of one run: events, truth, tracks and manifest, each of them whole."""

import json
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

from opir_core.errors import Problem, SceneError, reason_of
from opir_core.planning.plan import Plan
from opir_core.simulation.manifest import MANIFEST_VERSION

_REST = "the files are of different runs, or one of them is cut off; `opir run` writes all of them anew"
#: Truth and plan tell where and when a launch is to this many degrees or seconds.
_CLOSE = 1e-6


def refused(path: Path, where: str, message: str) -> SceneError:
    """Return the complaint about a place in a file."""
    return SceneError([Problem(where, message)], source=str(path))


def content(path: Path) -> bytes:
    """Return what a file holds; `SceneError` where the system does not let it be read."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise refused(path, "", f"cannot be read: {reason_of(error)}") from error


def read_manifest(path: Path) -> Mapping[str, Any]:
    """Return a run's manifest; `SceneError` where it is none."""
    try:
        manifest = json.loads(content(path))
    except ValueError as error:
        raise refused(path, "", f"not what opir writes: {error}") from error
    if not isinstance(manifest, dict) or "scene" not in manifest:
        raise refused(path, "", "not what opir writes: a manifest is a block with the scene")
    version = manifest.get("manifest_version")
    if version != MANIFEST_VERSION:
        words = f"of manifest version {version}, where {MANIFEST_VERSION} is read"
        raise refused(path, "manifest_version", f"{words}: run the scene anew, or score it with the opir that wrote it")
    if not isinstance(manifest.get("counts", {}), dict):
        raise refused(path, "counts", "not what opir writes: a block of counts is due")
    return manifest


def digest(path: Path) -> str:
    """Return the SHA-256 of a file's content, in hexadecimal digits."""
    return sha256(content(path)).hexdigest()


def require_tracks_of_run(tracks: Path, manifest: Mapping[str, Any]) -> None:
    """Refuse a file of tracks that is not the one that the manifest's run wrote."""
    written = manifest.get("tracks_sha256")
    if written is not None and written != digest(tracks):
        words = "not the tracks that the manifest's run wrote (their SHA-256 differs): "
        raise refused(tracks, "", f"{words}{_REST}, and --tracks judges tracks from elsewhere")


def require_events_of_run(
    events: Path, ids: Sequence[str], targets: Mapping[str, int], manifest: Mapping[str, Any]
) -> None:
    """Refuse events (their ids) that are not those of the truth (target by id), or not as many as the run made."""
    known = set(ids)
    unknown = next((each for each in ids if each not in targets), None)
    lacking = next((each for each in targets if each not in known), None)
    made = manifest.get("counts", {}).get("detections", len(ids))
    if unknown is not None:
        raise refused(events, "", f"detection {unknown} is not in the truth: {_REST}")
    if lacking is not None:
        raise refused(events, "", f"detection {lacking} of the truth is not among the events: {_REST}")
    if len(known) < len(ids):
        raise refused(events, "", f"{len(ids) - len(known)} detections are told twice; score the events of one run")
    if made != len(ids):
        raise refused(events, "", f"has {len(ids)} detections, where the manifest's run made {made}: {_REST}")


def require_launches_of_run(truth: Path, told: Sequence[Mapping[str, Any]], plan: Plan) -> None:
    """Refuse a truth whose targets are not those of the manifest's scene."""
    due = dict(zip(plan.targets.ids, plan.targets.truth(), strict=True))
    for target in told:
        name = target.get("target_id")
        if name not in due:
            raise refused(truth, "", f"the manifest's scene has no target {name}: {_REST}")
        if _differ(target, due[name]):
            words = f"{name} flies otherwise in the manifest's scene, by the plugins installed"
            raise refused(truth, "", f"{words}: {_REST}")


def _differ(told: Mapping[str, Any], due: Mapping[str, Any]) -> bool:
    pairs = [(told.get(name), due.get(name)) for name in ("ignition_s", "burnout_s")]
    for name in ("launch", "burnout", "impact"):
        mine, theirs = told.get(name), due.get(name)
        if isinstance(mine, dict) and isinstance(theirs, Mapping):
            pairs += [(mine.get(angle), theirs.get(angle)) for angle in ("lat_deg", "lon_deg")]
    known = [(mine, theirs) for mine, theirs in pairs if isinstance(mine, float) and isinstance(theirs, float)]
    return any(abs(mine - theirs) > _CLOSE for mine, theirs in known)
