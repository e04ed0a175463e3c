"""A page of figures names what its script sets away from the defaults."""

import ast
import re

import pytest
from repository import ROOT

#: Values that the settings have by default: `detection: auto` is `snr` with light, and with `snr`
#: types are those of `spectral`; `DSP` with light is `heritage`. Air, background and a tracker are
#: what README's scenes have.
DEFAULTS = {
    "atmosphere": {"lowtran"},
    "background": {"earth"},
    "classification": {"spectral"},
    "confirmation_detections": set[str](),
    "detection": {"auto", "snr"},
    "focal_plane": {"notional"},
    "nei_w_m2": set[str](),
    "preset": {"heritage"},
    "spectral_discrimination": set[str](),
    "tracker": {"imm", "none"},
}
SCRIPTS = ROOT / "benchmarks"
PAGES = ROOT / "docs"
#: The page of a script of another name.
PAGE_OF = {
    "calibration_foreign": "calibration",
    "calibration_scenes": "calibration",
    "coverage_map": "coverage",
    "fires_hour": "open_world",
    "tracker_comparison": "comparing-trackers",
    "tracking_set/set_trackers": "tracking_set",
}
OVERRIDE = re.compile(rf"^(?:.*\.)?({'|'.join(DEFAULTS)})=([\w.+-]+)$")


def changes(source):
    """Yield the settings that a script gives another value than the default, in mappings and in
    overrides.
    """
    for node in ast.walk(ast.parse(source)):
        for key, value in settings(node):
            if key in DEFAULTS and value not in DEFAULTS[key]:
                yield key, value


def settings(node):
    """Yield the settings with a value that stands in a node."""
    if isinstance(node, ast.Dict):
        for key, value in zip(node.keys, node.values, strict=True):
            if isinstance(key, ast.Constant) and (written := written_value(value)) is not None:
                yield str(key.value), written
    elif isinstance(node, ast.Constant) and (match := OVERRIDE.match(str(node.value))):
        yield match[1], match[2]


def written_value(node):
    """Return a constant, or the model of a mapping, as a scene writes it; else None."""
    if isinstance(node, ast.Dict):
        models = [
            value
            for key, value in zip(node.keys, node.values, strict=True)
            if isinstance(key, ast.Constant) and key.value == "model"
        ]
        return written_value(models[0]) if models else None
    if isinstance(node, ast.Constant):
        return "null" if node.value is None else str(node.value)
    return None


def page_of(script):
    """Return the page of a script, if there is one."""
    name = script.relative_to(SCRIPTS).with_suffix("").as_posix()
    stem = PAGE_OF.get(name, script.stem.removesuffix("_page"))
    result = [PAGES / folder / f"{stem}.md" for folder in ("benchmarks", "explanation")]
    return next((page for page in result if page.exists()), None)


def lacking(source, page):
    """Return the changed settings of a script that a page does not name."""
    named = re.sub(r"\s+", " ", page)
    return {text for key, value in changes(source) if (text := f"`{key}: {value}`") not in named}


CHANGING = [path for path in sorted(SCRIPTS.rglob("*.py")) if any(changes(path.read_text("utf-8")))]


@pytest.mark.parametrize("script", CHANGING, ids=[path.stem for path in CHANGING])
def test_a_page_names_what_its_script_sets_away_from_the_defaults(script):
    page = page_of(script)
    assert page is not None, f"{script.stem} has no page: where are its figures?"
    assert lacking(script.read_text("utf-8"), page.read_text("utf-8")) == set()


@pytest.mark.parametrize(
    ("source", "text"),
    [
        ('run("classification=paper")', "`classification: paper`"),
        ('run("sensors[*].focal_plane=null")', "`focal_plane: null`"),
        ('scene = {"detection": "constant"}', "`detection: constant`"),
        ('scene = {"classification": {"model": "paper"}}', "`classification: paper`"),
        ('scene = {"sensors": [{"focal_plane": None}]}', "`focal_plane: null`"),
        ('scene = {"sensors": [{"nei_w_m2": 1e-12}]}', "`nei_w_m2: 1e-12`"),
        ('scene = {"sensors": [{"preset": "paper"}]}', "`preset: paper`"),
    ],
)
def test_a_changed_setting_is_found_however_it_is_written(source, text):
    assert lacking(source, "All else is default.") == {text}
    assert lacking(source, f"Made with {text}.") == set()


def test_defaults_need_no_words():
    assert not list(changes('{"detection": "snr", "classification": "spectral"}'))
