"""What varies in a study: levels of each path, and the designs made of them."""

from itertools import product

import numpy as np
import pytest
from opir_studies import Study
from opir_studies.axes import designs_of, vary_of_text

from opir_core.errors import SceneError


def levels(values, **settings):
    """Return the labels and texts of the levels of a path."""
    designs = designs_of(Study(scene="x", vary={"p": values}, **settings))
    return [(level.label, level.text) for design in designs for level in design.levels]


@pytest.mark.parametrize(
    ("values", "labels"),
    [
        ({"from": 50, "to": 200, "step": 50}, [50, 100, 150, 200]),
        ({"from": 0, "to": 1, "step": 0.3}, [0, 0.3, 0.6, 0.9]),
        ({"from": 0, "to": 0.3, "step": 0.1}, [0, 0.1, 0.2, 0.3]),
        ({"from": 50, "to": 200, "count": 4}, [50, 100, 150, 200]),
        ({"from": 1, "to": 1000, "count": 4, "scale": "log"}, [1, 10, 100, 1000]),
    ],
)
def test_ranges_have_both_ends(values, labels):
    assert [label for label, _ in levels(values)] == labels


def test_values_become_overrides_that_mean_the_same():
    values = ["imm", 2, 0.5, True, None, {"model": "imm", "cadence_s": 2.0}, "ümlaut"]
    assert [text for _, text in levels(values)] == [
        '"imm"',
        "2",
        "0.5",
        "true",
        "null",
        '{"model": "imm", "cadence_s": 2.0}',
        '"ümlaut"',
    ]
    assert levels({"named": {"two": [{"constellation": "DSP"}], "none": None}}) == [
        ("two", '[{"constellation": "DSP"}]'),
        ("none", "null"),
    ]


@pytest.mark.parametrize(
    ("text", "path", "values"),
    [
        ("sensors[*].scan_period_ms=50,100", "sensors[*].scan_period_ms", [50, 100]),
        ("tracker=imm,kepler-arc", "tracker", ["imm", "kepler-arc"]),
        (
            "tracker={model: imm, cadence_s: 2},none",
            "tracker",
            [{"model": "imm", "cadence_s": 2}, "none"],
        ),
        ("a.b={from: 1, to: 3, step: 1}", "a.b", {"from": 1, "to": 3, "step": 1}),
        ("scene='a, b',\"c\"", "scene", ["a, b", "c"]),
        ("x=[1, 2],[3]", "x", [[1, 2], [3]]),
    ],
)
def test_values_of_the_command_line(text, path, values):
    assert vary_of_text(text) == (path, values)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([], "the list is empty"),
        ([1, 2, 1], "1 is given twice"),
        ({"from": 2, "to": 1, "step": 1}, "is not [low, high] with low below high"),
        ({"from": 1, "to": 2, "step": 0}, "step 0 is not positive"),
        ({"from": 1, "to": 2, "step": 1e-9}, "gives more than 10000 values"),
        ({"from": 1, "to": 2, "count": 1}, "count 1 is not a whole number from 2"),
        (
            {"from": 0, "to": 2, "count": 3, "scale": "log"},
            "a logarithmic scale needs positive bounds",
        ),
        ({"from": 1, "to": 2, "count": 3, "scale": "cubic"}, "scale 'cubic' is not linear or log"),
        ({"uniform": [1, 2]}, "uniform is for design: latin-hypercube"),
        ({"between": [1, 2]}, "{between} says no values; write a list"),
    ],
)
def test_an_invalid_axis_says_what_to_write(values, words):
    with pytest.raises(SceneError) as caught:
        levels(values)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tracker", "has no values"),
        ("tracker=", "has no values"),
        ("=1", "has no values"),
        ("x=1,,2", "a value is missing between two commas"),
        ("x=[1", "','"),
    ],
)
def test_an_invalid_vary_is_refused(text, words):
    with pytest.raises(ValueError, match=words):
        vary_of_text(text)


def rows(**settings):
    designs = designs_of(Study(scene="x", **settings))
    return [tuple(level.label for level in design.levels) for design in designs]


def test_designs_are_all_combinations_the_first_path_slowest():
    vary = {"a": [1, 2], "b": ["x", "y", "z"]}
    assert rows(vary=vary) == list(product([1, 2], "xyz"))
    assert rows(vary=vary, design="one-at-a-time") == [(1, "x"), (2, "x"), (1, "y"), (1, "z")]
    assert rows(vary={}) == [()]


def test_a_latin_hypercube_has_a_sample_in_each_cell_of_an_axis():
    hypercube = {
        "vary": {
            "a": {"uniform": [10.0, 20.0]},
            "b": {"uniform": [1.0, 1e4], "scale": "log"},
            "c": ["x", "y"],
        },
        "design": "latin-hypercube",
        "samples": 16,
    }
    samples = rows(**hypercube)
    a, b, c = zip(*samples, strict=True)
    for share in ((np.array(a) - 10.0) / 10.0, np.log10(b) / 4.0):
        assert sorted((share * 16).astype(int).tolist()) == list(range(16))
    assert c.count("x") == c.count("y") == 8
    assert samples == rows(**hypercube)
    assert samples != rows(**hypercube, seed=1)


def test_all_invalid_axes_and_too_many_designs_are_reported():
    with pytest.raises(SceneError) as caught:
        rows(vary={"a": [], "b": {"to": 3}, "c": [1]})
    assert [problem.path for problem in caught.value.problems] == ["vary.a", "vary.b"]
    hundred = {"from": 0, "to": 99, "step": 1}
    with pytest.raises(SceneError, match="more than 10000 designs"):
        rows(vary=dict.fromkeys("abc", hundred))
