"""The ledger of claims: what is called validated has a test against an oracle that shares no code
with opir.
"""

import ast
import json
import re
import sys
from functools import cache

import pytest
from repository import DATA, ROOT

sys.path.insert(0, str(ROOT / "docs"))

from claims import claims_page
from opir_testing.commands.claims import ledger

AGAINST = ROOT / "tests" / "against"
SUPPORT = ROOT / "tests" / "support"
ROWS = ledger()
VALIDATED = [row for row in ROWS if row["status"] == "VALIDATED"]
IDS = [row["claim"] for row in VALIDATED]

#: Where oracles by calculation may stand, beside `tests/support`.
BENCHMARKS = ROOT / "benchmarks"


@cache
def tree_of(name):
    return ast.parse((AGAINST / name).read_text(encoding="utf-8"))


def imported(tree):
    """Yield the modules that a file imports, and those that it finds by `importorskip` or
    `import_module`.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
        elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if name in ("importorskip", "import_module"):
                yield str(node.args[0].value)


def is_literal(node):
    try:
        ast.literal_eval(node)
    except ValueError:
        return False
    return True


def literal_names(tree):
    """Yield the names that a module gives plain numbers, not what opir computes."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and is_literal(node.value):
            for target in node.targets:
                yield from (name.id for name in ast.walk(target) if isinstance(name, ast.Name))


def names_in(tree):
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def is_opirs(module):
    return module.partition(".")[0].startswith("opir_")


def function_of(row):
    file, _, test = row["test"].partition("::")
    result = [
        node
        for node in tree_of(file).body
        if isinstance(node, ast.FunctionDef) and node.name == test
    ]
    assert len(result) == 1, f"{row['claim']}: {file} has no {test}"
    return result[0]


def fault(row):
    """Return what is wrong with the oracle of a claim, or ""."""
    file = row["test"].partition("::")[0]
    kind, _, name = row["oracle"].partition(" ")
    tree = tree_of(file)
    function = function_of(row)
    if kind in ("import", "script"):
        is_there = any(module.partition(".")[0] == name for module in imported(tree))
        return "" if is_there and not is_opirs(name) else f"{file} does not import {name}"
    if kind == "data":
        text = (AGAINST / file).read_text(encoding="utf-8")
        return "" if (DATA / name).is_file() and name in text else f"{file} does not read {name}"
    if kind == "constants":
        numbers = set(literal_names(tree))
        return (
            ""
            if numbers & names_in(function) or has_numbers(function)
            else f"{row['test']} has no figures"
        )
    folders = [folder for folder in (SUPPORT, BENCHMARKS) if (folder / f"{name}.py").is_file()]
    if kind != "support" or not folders or name not in set(imported(tree)):
        return f"{file} does not import {name}"
    oracle = ast.parse((folders[0] / f"{name}.py").read_text(encoding="utf-8"))
    opir_modules = sorted(
        module for module in imported(oracle) if is_opirs(module) and not module.endswith("arrays")
    )
    return f"the oracle {name} imports {', '.join(opir_modules)}" if opir_modules else ""


def has_numbers(function):
    """Return whether a test compares with numbers of its own."""
    return any(
        isinstance(node, ast.Constant) and isinstance(node.value, int | float)
        for compare in ast.walk(function)
        if isinstance(compare, ast.Compare)
        for node in ast.walk(compare)
    )


@pytest.mark.parametrize("row", VALIDATED, ids=IDS)
def test_what_is_called_validated_has_an_oracle_that_shares_no_code(row):
    assert fault(row) == ""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"oracle": "import opir_photons"}, "does not import opir_photons"),
        ({"oracle": "import skyfield"}, "does not import skyfield"),
        ({"oracle": "data nothing.csv"}, "does not read nothing.csv"),
        ({"oracle": "support imager_pixels"}, "does not import imager_pixels"),
        (
            {
                "test": "test_against_goes_sightings.py::test_facts_that_hold_at_the_level_and_within_the_spread",
                "oracle": "support imager_pixels",
            },
            "the oracle imager_pixels imports",
        ),
    ],
)
def test_an_oracle_that_is_none_is_found(change, words):
    row = next(row for row in VALIDATED if row["oracle"] == "script mpmath")
    assert words in fault({**row, **change})


def test_each_claim_has_a_status_and_says_why():
    for row in ROWS:
        assert row["status"] in ("VALIDATED", "MODELLED", "NOTIONAL")
        assert row["claim"]
        assert row["figure"]
        assert row["area"]
        assert ("test" in row) == (row["status"] == "VALIDATED") != ("why" in row)
    names = [row["claim"] for row in ROWS]
    assert len(set(names)) == len(names)


def test_no_test_holds_two_claims():
    tests = [row["test"] for row in VALIDATED]
    assert len(set(tests)) == len(tests)


#: How many claims are validated: it only rises.
LEAST_VALIDATED = 87


def test_the_number_of_validated_claims_only_rises():
    assert len(VALIDATED) >= LEAST_VALIDATED
    assert len(ROWS) <= 110


def test_tables_of_the_page_have_at_most_20_rows():
    for section in claims_page().split("\n## ")[1:]:
        assert len(re.findall(r"^\| ", section, re.MULTILINE)) <= 21


def test_the_figure_of_the_sightings_is_that_of_their_table():
    facts = json.loads((DATA / "goes_sightings.json").read_text(encoding="utf-8"))["looks"]
    count = sum(len(look["seen"]) + len(look["unseen"]) for look in facts)
    missed = sum(len(look.get("missed_k", ())) for look in facts)
    row = next(row for row in ROWS if row["claim"].startswith("launches that GOES-16 saw"))
    assert row["figure"].startswith(f"{count - missed} of {count} band facts")


@pytest.mark.parametrize(
    "words", ["EchoStar 23 in the water bands", "burns against the flight", "long waves of"]
)
def test_a_sighting_that_is_missed_is_a_row_with_its_figure(words):
    (row,) = [row for row in ROWS if row["claim"].startswith(words)]
    assert row["status"] == "MODELLED"
    assert re.match(r"\d\.\d", row["figure"])
