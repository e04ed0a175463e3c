"""A new plugin's package: its name judged, its files made of the templates in the wheel."""

import keyword
import re
import sys
from collections.abc import Mapping
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template

from attrs import frozen

from opir_core.errors import PluginError
from opir_core.plugin.api import API_VERSION, version_text
from opir_core.plugin.discovery import core_sources, installed_sources
from opir_core.plugin.host import Host

_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
_LONGEST = 40


@frozen
class TemplateKind:
    """A kind of plugin that can be written: its hook, its contract, and how a scene chooses one ("" its own scene)."""

    hook: str
    words: str
    contract: str
    choice: str = ""


#: The kinds by what the command line calls them.
KINDS: Mapping[str, TemplateKind] = {
    "sensor": TemplateKind("sensor_models", "sensor model", "SensorContract"),
    "tracker": TemplateKind("trackers", "tracker", "TrackerContract", "tracker: $name"),
    "detection": TemplateKind("detection_models", "detection model", "DetectionContract", "detection: $name"),
    "confidence": TemplateKind("confidence_models", "confidence model", "ConfidenceContract", "confidence: $name"),
    "sink": TemplateKind("sinks", "sink", "SinkContract", "outputs:\n  - $name"),
}


def plugin_files(kind: str, name: str, host: Host) -> Mapping[str, str]:
    """Return the text of each file of a new plugin's package, by its path in it.

    Raises `PluginError` for a name that is no name, or is taken.
    """
    complaint = _complaint(kind, name, host)
    if complaint:
        raise PluginError(f"a {KINDS[kind].words} cannot be named {name!r}: {complaint}")
    words = _words(KINDS[kind], name)
    package = words["package"]
    return {
        "pyproject.toml": _filled("common/pyproject.toml", words),
        "README.md": _filled("common/README.md", words),
        f"{package}.py": _filled(f"{kind}/plugin.py", words),
        "scene.yaml": _filled("common/scene.yaml" if KINDS[kind].choice else f"{kind}/scene.yaml", words),
        f"test_{package}.py": _filled("common/test_contract.py", words),
    }


def write_plugin(folder: Path, contents: Mapping[str, str]) -> None:
    """Write a package into a folder that is not there yet; raises `PluginError` where it is, or cannot be made."""
    if folder.exists():
        raise PluginError(f"{folder} is there already, and nothing is overwritten; choose another name, or move it")
    try:
        folder.mkdir(parents=True)
        for path, text in contents.items():
            (folder / path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise PluginError(f"{folder} cannot be written: {error.strerror}") from error


def _complaint(kind: str, name: str, host: Host) -> str:
    if not _NAME.fullmatch(name) or len(name) > _LONGEST:
        return (
            f"names are at most {_LONGEST} small letters, digits and single hyphens, and begin with a letter,"
            " like my-sensor"
        )
    package = name.replace("-", "_")
    if keyword.iskeyword(package) or package in sys.stdlib_module_names:
        return f"{package} is a word of Python's own"
    if name in host.names(f"opir_{KINDS[kind].hook}"):
        return f"{host.provenance(f'opir_{KINDS[kind].hook}', name)} offers one of that name"
    if name in {source.provenance.plugin for source in [*core_sources(), *installed_sources()]}:
        return "a plugin of that name is installed"
    return f"a module {package} is installed" if find_spec(package) is not None else ""


def _words(kind: TemplateKind, name: str) -> Mapping[str, str]:
    """Return what the templates' placeholders stand for."""
    words = {
        "name": name,
        "package": name.replace("-", "_"),
        "Class": "".join(part.capitalize() for part in name.split("-")),
        "TYPE": name.upper(),
        "api": version_text(API_VERSION),
        "hook": kind.hook,
        "kind": kind.words,
        "kind_plural": f"{kind.words}s",
        "Article": "A",
        "Contract": kind.contract,
    }
    return {**words, "choice": Template(kind.choice).substitute(words)}


def _filled(template: str, words: Mapping[str, str]) -> str:
    text = files("opir_core").joinpath("templates", *f"{template}.txt".split("/")).read_text(encoding="utf-8")
    return Template(text).substitute(words)
