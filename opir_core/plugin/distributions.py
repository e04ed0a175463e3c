"""Installed distributions and their entry points, read from metadata files; nothing of them is imported.

`importlib.metadata` says the same, but importing and asking it costs several times what reading the files does (the
measurement is `docs/design/discovery_cost.py`). Directories are therefore read here, and it is asked only about what is
not a directory: archives, eggs, and finders other than Python's own.
"""

import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any

from attrs import frozen

_METADATA_FOLDERS = (".dist-info", ".egg-info")
_METADATA_FILES = ("METADATA", "PKG-INFO")

#: Returns the text of a metadata file by its name, "" where there is none.
_Reader = Callable[[str], str]


@frozen
class Distribution:
    """An installed distribution: entry points are (name, value) pairs by group, in the order of the file."""

    name: str
    version: str
    entry_points: Mapping[str, Sequence[tuple[str, str]]]


def distributions_with(groups: Collection[str]) -> list[Distribution]:
    """Return the distributions that have entry points in any of the groups, sorted by name.

    Of several with one name (an editable install and a checkout on `PYTHONPATH`, say) the first on `sys.path` counts,
    as it does for imports.
    """
    found: dict[str, Distribution] = {}
    for folder_name, read in _readers():
        sections = _sections(read("entry_points.txt"))
        entry_points = {group: sections[group] for group in groups if group in sections}
        if entry_points:
            name, version = _name_and_version(read, folder_name)
            found.setdefault(_canonical(name), Distribution(name, version, entry_points))
    return [found[key] for key in sorted(found)]


def _readers() -> Iterator[tuple[str, _Reader]]:
    for entry in dict.fromkeys(map(str, sys.path)):
        if entry.endswith(".egg") or Path(entry).is_file():
            yield from _readers_by_importlib(path=[entry])
        else:
            yield from _readers_in_directory(Path(entry))
    if any(hasattr(finder, "find_distributions") for finder in sys.meta_path if finder is not PathFinder):
        yield from _readers_by_importlib()


def _readers_in_directory(directory: Path) -> Iterator[tuple[str, _Reader]]:
    try:
        names = sorted(path.name for path in directory.iterdir() if path.name.endswith(_METADATA_FOLDERS))
    except OSError:
        return
    for name in names:
        yield name, _reader(directory / name)


def _reader(folder: Path) -> _Reader:
    def read(file_name: str) -> str:
        try:
            return (folder / file_name).read_text(encoding="utf-8", errors="replace")
        except OSError:
            return ""

    return read


def _readers_by_importlib(**where: Any) -> Iterator[tuple[str, _Reader]]:
    from importlib import metadata

    for distribution in metadata.distributions(**where):
        yield "", partial(_text, distribution.read_text)


def _text(read: Callable[[str], str | None], file_name: str) -> str:
    return read(file_name) or ""


def _sections(text: str) -> dict[str, list[tuple[str, str]]]:
    sections: dict[str, list[tuple[str, str]]] = {}
    group = ""
    for line in _lines(text):
        if line.startswith("[") and line.endswith("]"):
            group = line[1:-1].strip()
        elif "=" in line:
            name, _, value = line.partition("=")
            sections.setdefault(group, []).append((name.strip(), value.strip()))
    return sections


def _lines(text: str) -> Iterable[str]:
    stripped = (line.strip() for line in text.splitlines())
    return (line for line in stripped if line and not line.startswith("#"))


def _name_and_version(read: _Reader, folder_name: str) -> tuple[str, str]:
    text = next(filter(None, map(read, _METADATA_FILES)), "")
    headers: dict[str, str] = {}
    for line in text.partition("\n\n")[0].splitlines():
        key, colon, value = line.partition(":")
        if colon and not key[:1].isspace():
            headers[key.lower()] = value.strip()
    stem_name, _, stem_version = folder_name.rpartition(".")[0].partition("-")
    return headers.get("name") or stem_name, headers.get("version") or stem_version


def _canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
