"""Runs and studies made again from what their folders hold: the same bytes, or what differs."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from attrs import frozen

from opir_core import compile_plan, load_scene
from opir_core.errors import BAD_DATA, reason_of
from opir_core.output import FILES_KEY, deliver, file_digest
from opir_studies.refusals import refusal
from opir_studies.result import DEFINITION
from opir_studies.runs import installed_version
from opir_studies.study import study_of_keys
from opir_studies.sweeping import StudyProgress, sweep

_MANIFEST = ".manifest.json"


@frozen
class Rerun:
    """What was made again: its folder, the files that have the same bytes, those that do not, and
    reasons why they may differ.
    """

    folder: Path
    same: tuple[str, ...]
    different: tuple[str, ...]
    reasons: tuple[str, ...]


def rerun(
    source: str | Path,
    folder: str | Path,
    *,
    workers: int | None = None,
    on_progress: Callable[[StudyProgress], None] = lambda _progress: None,
) -> Rerun:
    """Make a study, or a run, again into a new folder from what its own folder holds.

    `source` is the folder of a study or of one run, or the manifest of a run. Raises `SceneError`
    where there is none, or where its scene is invalid here.
    """
    place = Path(source)
    target = Path(folder)
    study = place / DEFINITION if place.is_dir() else place
    if study.name == DEFINITION and study.is_file():
        definition = _contents(study)
        if "objective" in definition:
            words = "is of a search, of which not all designs run; repeat its `opir optimise`"
            raise refusal("", words, str(study))
        again = study_of_keys(definition["made_of"], str(study))
        sweep(again, target, workers=workers, on_progress=on_progress)
        return _compared(definition, study.parent, target)
    manifest = _manifest_at(place)
    contents = _contents(manifest)
    _deliver_again(manifest, contents, target)
    return _compared(contents, manifest.parent, target)


def _manifest_at(place: Path) -> Path:
    """Return the manifest of the run at a path; raises `SceneError` unless there is one."""
    if place.is_file() and place.name.endswith(_MANIFEST):
        return place
    found = sorted(place.glob(f"*{_MANIFEST}")) if place.is_dir() else []
    if len(found) != 1:
        words = "holds no study (study.json) and no manifest of one run (*.manifest.json)"
        if len(found) > 1:
            words = f"holds several runs; name one: {', '.join(path.name for path in found)}"
        raise refusal("", words, str(place))
    return found[0]


def _contents(path: Path) -> dict[str, Any]:
    try:
        contents = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, *BAD_DATA) as error:
        reason = reason_of(error) if isinstance(error, OSError) else str(error)
        raise refusal("", f"cannot be read: {reason}", str(path)) from error
    keys = {"made_of", FILES_KEY} if path.name == DEFINITION else {FILES_KEY}
    if not isinstance(contents, dict) or not keys <= contents.keys():
        words = f"lacks {' or '.join(sorted(keys))}: run the scene or study again"
        raise refusal("", words, str(path))
    try:
        _version_reasons(contents)
        _digests(contents)
    except BAD_DATA as error:
        words = f"its versions or files are damaged ({error}): run the scene or study again"
        raise refusal("", words, str(path)) from error
    return contents


def _digests(contents: Mapping[str, Any]) -> dict[str, str]:
    """Return the SHA-256 of each file, by the name that it was written with."""
    return {str(entry["name"]): str(entry["sha256"]) for entry in contents[FILES_KEY]}


def _deliver_again(manifest: Path, contents: Mapping[str, Any], folder: Path) -> None:
    """Write the files of a run again, of the same kinds and names."""
    paths = {entry["kind"]: folder / Path(entry["name"]).name for entry in contents[FILES_KEY]}
    folder.mkdir(parents=True, exist_ok=True)
    overrides = []
    if "events" in paths:
        sink = "parquet" if paths["events"].suffix == ".parquet" else "jsonl"
        overrides = [f"outputs=[{{{sink}: {{path: {json.dumps(str(paths['events']))}}}}}]"]
    outcome = deliver(
        compile_plan(load_scene(manifest, overrides=overrides)),
        truth_path=paths.get("truth"),
        tracks_path=paths.get("tracks"),
        commands_path=paths.get("commands"),
        manifest_path=folder / manifest.name,
    )
    outcome.raise_for_failures()


def _compared(contents: Mapping[str, Any], origin: Path, folder: Path) -> Rerun:
    digests = _digests(contents)
    names = {name: Path(name).name for name in digests}
    same = [name for name, own in names.items() if _digest(folder / own) == digests[name]]
    different = [name for name in names if name not in same]
    reasons = [*_version_reasons(contents), *_file_reasons(origin, names, digests)]
    return Rerun(folder, tuple(same), tuple(different), tuple(reasons) if different else ())


def _digest(path: Path) -> str:
    return file_digest(path) if path.is_file() else ""


def _version_reasons(contents: Mapping[str, Any]) -> list[str]:
    """Return the versions that are not those that made the files."""
    versions: dict[str, str] = dict(contents.get("versions", {}))
    versions.pop("python", None)
    for component in contents.get("components", ()):
        versions[component["distribution"]] = component["version"]
    installed = {name: installed_version(name) for name in versions}
    return [
        f"{name} was {version}, and is {installed[name]} here"
        for name, version in versions.items()
        if installed[name] != version
    ]


def _file_reasons(origin: Path, names: Mapping[str, str], digests: Mapping[str, str]) -> list[str]:
    """Return the original files that are no longer what was written."""
    return [
        f"{name} is no longer what was written there"
        for name in names
        if (origin / name).is_file() and file_digest(origin / name) != digests[name]
    ]
