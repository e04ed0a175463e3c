"""What makes a component fit to be offered, and words for what is wrong with a plugin."""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePath
from typing import Any

from attrs import has

from opir_core.plugin.components import Component, Constellation

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+-]{0,63}")
_NAME_RULE = "names are 1 to 64 letters, digits and . _ + -, and begin with a letter or a digit"
_LONGEST_WORDS = 300
_CORE = PurePath(__file__).parent.parent
_LIBRARIES = frozenset({"numpy", "scipy"})
_MACHINERY = (PurePath(__file__).parent.parts[-2:], ("importlib",))


class InvalidPlugin(Exception):  # noqa: N818 - a verdict on a plugin, which the host turns into a `PluginFailure`
    """A plugin that cannot be used; the message is the reason, without the plugin's name."""


def fault_in(component: Component | Constellation) -> str:
    """Return what is wrong with a component (`named 'a b'; …`, `'A' without …`), or "" where nothing is."""
    name: Any = component.name
    summary: Any = component.summary
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        return f"named {_words(repr(name))}; {_NAME_RULE}"
    if not isinstance(summary, str) or not summary.strip() or len(summary.splitlines()) > 1:
        return f"named {name!r} whose summary is not one line of text"
    fault = _fault_in_fleet(component) if isinstance(component, Constellation) else _fault_in_parts(component)
    return f"named {name!r} {fault}" if fault else ""


def _fault_in_parts(component: Component) -> str:
    config: Any = component.config
    if not isinstance(config, type) or not has(config):
        return f"whose config is {_words(repr(config))}, not an attrs class"
    if not callable(component.build):
        return f"whose build is {_words(repr(component.build))}, not a function"
    presets: Any = component.presets
    if not isinstance(presets, Mapping) or not all(
        isinstance(name, str) and isinstance(values, Mapping) for name, values in presets.items()
    ):
        return "whose presets are not a mapping from names to mappings of values"
    return ""


def _fault_in_fleet(constellation: Constellation) -> str:
    model: Any = constellation.model
    satellites: Any = constellation.satellites
    if not isinstance(model, str) or not model:
        return f"whose model is {_words(repr(model))}, not the name of a sensor model"
    if not isinstance(satellites, Sequence) or not all(isinstance(satellite, Mapping) for satellite in satellites):
        return "whose satellites are not a sequence of mappings"
    ids = [satellite.get("id") for satellite in satellites]
    if not ids:
        return "without satellites"
    if not all(isinstance(name, str) and name for name in ids):
        return "with a satellite that has no id"
    return "with two satellites of one id" if len(set(ids)) < len(ids) else ""


def described_error(error: BaseException) -> str:
    """Return an exception as one line: its class, its words, and the line of the plugin that led to it."""
    try:
        words = _words(str(error))
    except Exception:
        words = ""
    place = _place(error)
    return f"{type(error).__name__}{f': {words}' if words else ''}{f' ({place})' if place else ''}"


def nearest(name: str, known: Iterable[str]) -> str:
    """Return `; the nearest is 'X'`, or "" where nothing known resembles the name. Letter case is ignored."""
    matches = nearest_names(name, known)
    return f"; the nearest is {matches[0]!r}" if matches else ""


def nearest_names(name: str, known: Iterable[str]) -> list[str]:
    """Return at most three known names that resemble the name, the most alike first. Letter case is ignored."""
    from difflib import get_close_matches

    spelt = {candidate.casefold(): candidate for candidate in sorted(known, reverse=True)}
    return [spelt[match] for match in get_close_matches(name.casefold(), spelt, n=3, cutoff=0.5)]


def _words(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST_WORDS else f"{line[:_LONGEST_WORDS]}…"


def _place(error: BaseException) -> str:
    """Return where the plugin's own code was: the innermost line of the first package outside the core, if any.

    Lines of the host, of the import system and of numpy and scipy do not count.
    """
    trace, of_core, of_plugin, package = error.__traceback__, "", "", None
    while trace is not None:
        frame = trace.tb_frame
        path = PurePath(frame.f_code.co_filename)
        line = f"{'/'.join(path.parts[-2:])}, line {trace.tb_lineno}"
        trace = trace.tb_next
        if _is_machinery(path):
            continue
        if path.is_relative_to(_CORE):
            of_core = line
            continue
        root = str(frame.f_globals.get("__name__", "")).partition(".")[0]
        package = package or root
        of_plugin = line if root == package else of_plugin
    return of_plugin or of_core


def _is_machinery(path: PurePath) -> bool:
    folder = path.parent.parts
    if not _LIBRARIES.isdisjoint(folder):
        return True
    return str(path).startswith("<frozen ") or any(folder[-len(own) :] == own for own in _MACHINERY)
