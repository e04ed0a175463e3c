"""The definition of a study: a scene, what varies, how often it runs, and which figures count."""

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from attrs import evolve, frozen

from opir_core.errors import Problem, SceneError, reason_of
from opir_core.plugin import nested, number, text
from opir_core.reading import (
    InvalidNode,
    class_reader,
    complaints_inside,
    is_quantity,
    node_of_yaml,
    number_in,
    ordered,
)
from opir_core.scene import file_bytes, text_of
from opir_studies.refusals import refusal

FACTORIAL, ONE_AT_A_TIME, LATIN_HYPERCUBE, SOBOL = DESIGNS = (
    "factorial",
    "one-at-a-time",
    "latin-hypercube",
    "sobol",
)

#: Designs whose settings are drawn from intervals.
SAMPLED = (LATIN_HYPERCUBE, SOBOL)

#: The most runs of one design.
MAXIMUM_RUNS = 1_000_000

#: Runs before the first decision to stop early.
MINIMUM_RUNS = 20


@frozen
class Study:
    """A study, as its file has it.

    `scene` is the path of a scene file or a scene as a mapping. Everything is checked by
    `opir_studies.sweep`, before the first run. Quantities of astropy or pint in `scene`,
    `overrides`, `vary` and `conditions` become numbers in the unit that ends the name of their
    setting.
    """

    scene: Any = nested(help="path of the scene, relative to the study's file", source="")
    study: str = text(help="name of the study", default="study", source="arbitrary")
    question: str = text(
        help="the question: the heading of the report, which begins with the answer; `vary` lists"
        " values from the least"
        " costly on",
        default="",
        source="arbitrary",
    )
    overrides: Mapping[str, Any] = nested(
        help="settings of the scene in all designs: path to value", default={}, source="arbitrary"
    )
    vary: Mapping[str, Any] = nested(
        help="what varies: path to a list, to {from, to, step} or {from, to, count, scale}, to"
        " {named: {name: value}},"
        " or to {uniform: [low, high], scale} for a Latin hypercube",
        default={},
        source="arbitrary",
    )
    conditions: Mapping[str, Any] = nested(
        help="what nobody chooses, such as epoch, cloud or launch site: paths to values, as in"
        " `vary`. Each design runs in all of their combinations, and is answered in each, in all and"
        " in the worst",
        default={},
        source="arbitrary",
    )
    split: str = text(
        help="the path of `vary` whose values are answered one by one, such as `targets` of one"
        " launch and of a raid;"
        " '' for none",
        default="",
        source="arbitrary",
    )
    design: str = text(
        help="which combinations run: all (factorial), the first one and each change of one setting"
        " (one-at-a-time), samples of a Latin hypercube, or those of Sobol indices (sobol)",
        default=FACTORIAL,
        choices=DESIGNS,
        source="arbitrary",
    )
    samples: int = number(
        help="designs of a Latin hypercube; of Sobol indices as many for each setting and two more,"
        " best a power of two",
        default=20,
        minimum=1,
        maximum=10_000,
        source="arbitrary",
    )
    seed: int = number(
        help="seed of the designs that are drawn; runs have the scene's seed plus their number",
        default=0,
        minimum=0,
        maximum=2**63 - 1,
        source="arbitrary",
    )
    runs: int = number(
        help="runs of each design; with `until` the most",
        default=100,
        minimum=1,
        maximum=MAXIMUM_RUNS,
        source="arbitrary",
    )
    until: str = text(
        help="stop a design early when the half width of the 95 % interval of a figure is small"
        " enough:"
        " `latency_s:0.5%` of the mean, or `latency_s:0.2` in its unit; `decided`: when every"
        " required share of launches is; '' for never",
        default="",
        source="arbitrary",
    )
    metrics: tuple[Any, ...] = nested(
        help="metrics, by name, or {name: settings}",
        default=("latency", "detection_by_time"),
        source="arbitrary",
    )
    show: tuple[str, ...] = nested(
        help="figures that the table and the report begin with; by default the first of each"
        " metric",
        default=(),
        source="arbitrary",
    )
    requirements: tuple[str, ...] = nested(
        help="bounds of means, `warning_time_s >= 900`, or shares of launches, `region_km2 < 1000"
        " within 90 s in 90 % of launches, in every condition`: lines in plots, and which designs"
        " meet them",
        default=(),
        source="arbitrary",
    )
    executor: Any = nested(
        help="where the runs are made: a name, or {name: settings}",
        default="processes",
        source="arbitrary",
    )

    def __attrs_post_init__(self) -> None:
        object.__setattr__(self, "scene", _without_units(self.scene))
        if not isinstance(self.scene, str | PathLike | Mapping):
            raise ValueError("scene: must be the path of a scene, or a block of one")
        for name in ("overrides", "vary", "conditions"):
            values = getattr(self, name)
            if isinstance(values, Mapping):
                plain = {path: _without_units(value, path) for path, value in values.items()}
                object.__setattr__(self, name, plain)


def _without_units(value: Any, path: str = "", key: str = "") -> Any:
    """Return values with quantities as numbers in the unit that ends the path, without one their
    key.
    """
    if isinstance(value, Mapping):
        return {name: _without_units(item, path, name) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_units(item, path, key) for item in value]
    if not is_quantity(value):
        return value
    try:
        return number_in(value, (path or key).rpartition("_")[2])
    except ValueError as error:
        raise refusal(path or key, str(error), "study") from error


def read_study(path: str | Path) -> Study:
    """Return the study of a YAML file; the path of its scene is relative to the file.

    Raises `SceneError` with each problem, its key and line.
    """
    place = Path(path)
    try:
        root = node_of_yaml(text_of(file_bytes(place)))
        complaints = list(complaints_inside(root))
        if complaints:
            raise InvalidNode(complaints)
        study: Study = class_reader(Study).made(root, ())
    except InvalidNode as refused:
        problems = [
            Problem(complaint.path, complaint.text) for complaint in ordered(refused.complaints)
        ]
        raise SceneError(problems, source=str(path)) from None
    except OSError as error:
        raise refusal("", f"cannot be read: {reason_of(error)}", str(path)) from None
    except ValueError as error:
        raise refusal("", str(error), str(path)) from None
    if isinstance(study.scene, str):
        return evolve(study, scene=str(place.parent / study.scene))
    return study


def study_of_keys(keys: Mapping[str, Any], source: str) -> Study:
    """Return the study of its keys, as a folder holds them; raises `SceneError` for others."""
    try:
        return Study(**keys)
    except (TypeError, ValueError) as error:
        words = f"is damaged or of another version of opir ({error}); run the study again"
        raise refusal("made_of", words, source) from error


def is_study(path: str | Path) -> bool:
    """Whether a file is a study rather than a scene: it has the key `scene`, and not `sensors`."""
    try:
        root = node_of_yaml(text_of(file_bytes(path)))
    except (InvalidNode, OSError, ValueError):
        return False
    return (
        isinstance(root.value, dict)
        and "scene" in root.value
        and not {"sensors", "epoch"} & root.value.keys()
    )
