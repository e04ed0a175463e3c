"""`opir new-plugin`: write the package of a new plugin that installs and passes its conformance
tests at once.

The files are made from the templates in the wheel. Only `$name` and what is derived from it vary.
"""

import argparse
import keyword
import re
import sys
from collections.abc import Mapping
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path
from string import Template

from attrs import frozen

from opir_core import __version__
from opir_core.errors import PluginError, with_article
from opir_core.host import core_sources, installed_sources, plural
from opir_core.plugin import Host

_NAME = re.compile(r"[a-z][a-z0-9]*(-[a-z0-9]+)*")
_LONGEST = 40

_SENSORS = """\
  - {model: generic-scanner, id: S-1, orbital_slot_deg: -100.0}
  - {model: generic-scanner, id: S-2, orbital_slot_deg: -150.0}"""

_OWN_SENSORS = """\
  - {model: $name, id: S-1, orbital_slot_deg: -100.0}
  - {model: $name, id: S-2, orbital_slot_deg: -150.0, scan_period_ms: 250}"""

_POINTED_SENSORS = """\
  - {model: generic-scanner, id: WIDE-1, orbital_slot_deg: -100.0}
  - {model: generic-scanner, id: WIDE-2, orbital_slot_deg: -150.0}
  - {model: generic-pointed, id: NARROW, orbital_slot_deg: -120.0}"""


@frozen
class TemplateKind:
    """A kind of component with a template: its hook, its name, its conformance tests, and how a
    scene chooses one.
    """

    hook: str
    words: str
    contract: str
    #: The line of the scene that chooses the component, "" where that is in `sensors` or `target`.
    choice: str = ""
    sensors: str = _SENSORS
    target: str = ""
    #: The class of the scene's target.
    target_class: str = "ICBM"


_RADIOMETRIC = "detection: snr"

#: The kinds by their names on the command line. Renderers have no template: one that is faster is
#: compiled code.
KINDS: Mapping[str, TemplateKind] = {
    "sensor": TemplateKind("sensor_models", "sensor model", "SensorContract", sensors=_OWN_SENSORS),
    "constellation": TemplateKind(
        "constellations",
        "constellation",
        "ConstellationContract",
        sensors="  - constellation: $name",
    ),
    "detection": TemplateKind(
        "detection_models", "detection model", "DetectionContract", "detection: $name"
    ),
    "classifier": TemplateKind(
        "classifiers", "classifier", "ClassifierContract", "classification: $name"
    ),
    "confidence": TemplateKind(
        "confidence_models", "confidence model", "ConfidenceContract", "confidence: $name"
    ),
    "tracker": TemplateKind("trackers", "tracker", "TrackerContract", "tracker: $name"),
    "associator": TemplateKind(
        "tracker_parts",
        "tracker part",
        "TrackerPartContract",
        "tracker: {model: imm, association: $name}",
    ),
    "director": TemplateKind(
        "directors",
        "director",
        "DirectorContract",
        "director: $name\ntracker: imm",
        sensors=_POINTED_SENSORS,
    ),
    "target": TemplateKind(
        "target_models", "target model", "TargetContract", target="    model: $name"
    ),
    "target-class": TemplateKind(
        "target_classes", "target class", "TargetClassContract", target_class="$name"
    ),
    "signature": TemplateKind(
        "signature_models",
        "signature model",
        "SignatureContract",
        _RADIOMETRIC,
        target="    signature: $name",
    ),
    "source": TemplateKind(
        "source_models",
        "source model",
        "SourceContract",
        f"sources:\n  - {{id: source, model: $name}}\n{_RADIOMETRIC}",
    ),
    "atmosphere": TemplateKind(
        "atmosphere_models",
        "atmosphere model",
        "AtmosphereContract",
        f"atmosphere: $name\n{_RADIOMETRIC}",
    ),
    "background": TemplateKind(
        "background_models",
        "background model",
        "BackgroundContract",
        f"background: $name\n{_RADIOMETRIC}",
    ),
    "encoder": TemplateKind(
        "event_encoders",
        "event encoder",
        "EncoderContract",
        "outputs:\n  - jsonl: {encoder: $name}",
    ),
    "sink": TemplateKind("sinks", "sink", "SinkContract", "outputs:\n  - $name"),
    "reader": TemplateKind("readers", "reader", "ReaderContract"),
    "metric": TemplateKind("metrics", "metric", "MetricContract"),
    "executor": TemplateKind("executors", "executor", "ExecutorContract"),
    "exporter": TemplateKind("exporters", "exporter", "ExporterContract"),
    "view": TemplateKind("run_views", "run view", "RunViewContract"),
}


def new_plugin_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the kind, the name and the folder."""
    parser.add_argument("kind", choices=list(KINDS), help="the kind of component")
    parser.add_argument(
        "name", metavar="NAME", help="the name in scenes, and of the package, e.g. my-sensor"
    )
    parser.add_argument(
        "--into", metavar="FOLDER", default=".", help="the parent of the new folder (default: here)"
    )


def new_plugin(arguments: argparse.Namespace) -> int:
    """Write the package and print the next steps."""
    contents = plugin_files(arguments.kind, arguments.name, Host.discover())
    folder = Path(arguments.into) / arguments.name
    write_plugin(folder, contents)
    lines = [
        *(f"{folder / path}" for path in contents),
        "",
        "next:",
        f"  python -m pip install -e {folder if folder.is_absolute() else f'./{folder}'}",  # a bare name is of an index
        f"  opir check {arguments.name}",
        f"  opir run {folder / 'scene.yaml'}",
    ]
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


def plugin_files(kind: str, name: str, host: Host) -> Mapping[str, str]:
    """Return the text of each file of a new plugin's package by its path; raises `PluginError` for
    an invalid name.
    """
    error = _error_in_name(kind, name, host)
    if error:
        raise PluginError(f"{with_article(KINDS[kind].words)} cannot be named {name!r}: {error}")
    words = _words(KINDS[kind], name)
    code = _filled(f"{kind}/plugin.py", words)
    package = words["package"]
    return {
        "pyproject.toml": _filled(
            "common/pyproject.toml", {**words, "dependencies": _dependencies(code)}
        ),
        "README.md": _filled("common/README.md", words),
        f"{package}.py": code,
        "scene.yaml": "\n".join(filter(None, _filled("common/scene.yaml", words).splitlines()))
        + "\n",
        f"test_{package}.py": _filled("common/test_contract.py", words),
    }


def write_plugin(folder: Path, contents: Mapping[str, str]) -> None:
    """Write a package into a new folder; raises `PluginError` if the folder exists or cannot be
    made.
    """
    if folder.exists():
        raise PluginError(
            f"{folder} exists, and nothing is overwritten; choose another name, or move it"
        )
    try:
        folder.mkdir(parents=True)
        for path, text in contents.items():
            (folder / path).write_text(text, encoding="utf-8")
    except OSError as error:
        raise PluginError(f"{folder} cannot be written: {error.strerror}") from error


def _error_in_name(kind: str, name: str, host: Host) -> str:
    if not _NAME.fullmatch(name) or len(name) > _LONGEST:
        return (
            f"names are at most {_LONGEST} small letters, digits and single hyphens, and begin with"
            " a letter, like my-sensor"
        )
    package = name.replace("-", "_")
    if keyword.iskeyword(package) or package in sys.stdlib_module_names:
        return f"{package} is a keyword or standard module of Python"
    if name in host.names(f"opir_{KINDS[kind].hook}"):
        return (
            f"{host.provenance(f'opir_{KINDS[kind].hook}', name)} offers a component of that name"
        )
    if name in {source.provenance.plugin for source in [*core_sources(), *installed_sources()]}:
        return "a plugin of that name is installed"
    return f"a module {package} is installed" if find_spec(package) is not None else ""


def _words(kind: TemplateKind, name: str) -> Mapping[str, str]:
    """Return the values of the templates' placeholders; all that name the plugin derive from
    `name`.
    """
    words = {
        "name": name,
        "package": name.replace("-", "_"),
        "hook": kind.hook,
        "kind": kind.words,
        "kind_plural": plural(kind.words),
        "Article": with_article(kind.words).partition(" ")[0].capitalize(),
        "Contract": kind.contract,
    }
    settings = {
        "choice": kind.choice,
        "sensors": kind.sensors,
        "target": kind.target,
        "type": kind.target_class,
    }
    return {**words, **{key: Template(text).substitute(words) for key, text in settings.items()}}


def _dependencies(code: str) -> str:
    """Return the requirements of a plugin's code, as an array of TOML without brackets."""
    bounds = {
        "attrs": "attrs>=24.2",
        "numpy": "numpy>=2.0.2",
        "opir_trackers": f"opir-trackers{_core_range(__version__)}",
    }
    named = [
        bound
        for module, bound in bounds.items()
        if re.search(rf"^(from|import) {module}\b", code, re.MULTILINE)
    ]
    return ", ".join(
        f'"{requirement}"' for requirement in [*named, f"opir-core{_core_range(__version__)}"]
    )


def _filled(template: str, words: Mapping[str, str]) -> str:
    text = (
        files("opir_testing")
        .joinpath("templates", *f"{template}.txt".split("/"))
        .read_text(encoding="utf-8")
    )
    return Template(text).substitute(words)


def _core_range(version: str) -> str:
    """Return the versions of opir-core that a plugin written for one works with, `>=0.1,<0.2` for
    0.1.0.
    """
    major, minor = map(int, version.split(".")[:2])
    return f">={major}.{minor},<{major + 1}" if major else f">=0.{minor},<0.{minor + 1}"
