"""Pages are read: short, in the field's words, with plots instead of long tables."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "plugins").glob("*/README.md")]
)

#: References that are generated whole are as long as what they list.
GENERATED = re.compile(
    r"docs/reference/(api/.*|claims|commands|components|http|paper-figures|scene)\.md"
)

MOST_WORDS = 1500
MOST_ROWS = 20

#: Words that a reader must guess, and what the field calls them.
GUESSED = {
    r"\bkeeps? the promises?\b": "passes the conformance tests",
    r"\b(is|are|was|were|be) told\b": "is reported",
    r"\btold (of|by|as)\b": "reported by",
    r"\bof whom\b": "name the thing",
    r"\bas if so many\b": "say how many",
    r"\bcannot be meant\b": "is invalid",
    r"\bmore is too sure\b": "above 1 is overconfident",
    r"\b(rays?|spots?|doubles|strays?) of (tracks?|targets?)\b": "lines of sight, clusters,"
    " duplicates, outliers",
}


def named(page):
    return str(page.relative_to(ROOT))


WRITTEN = [page for page in PAGES if not GENERATED.fullmatch(named(page))]


def table_rows(text):
    """Yield how many rows each table has, its head aside."""
    for table in re.findall(r"(?:^\|.*\n)+", f"{text}\n", re.MULTILINE):
        yield table.count("\n") - 2


@pytest.mark.parametrize("page", WRITTEN, ids=named)
def test_pages_are_short(page):
    text = page.read_text(encoding="utf-8")
    assert len(text.split()) <= MOST_WORDS
    assert max(table_rows(text), default=0) <= MOST_ROWS, (
        "plot it, and put the data beside the page as CSV"
    )


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_pages_use_the_fields_words(page):
    text = " ".join(page.read_text(encoding="utf-8").split())
    assert not {
        result[0]: better
        for words, better in GUESSED.items()
        for result in [re.search(words, text)]
        if result
    }


def test_places_of_changes_exist() -> None:
    text = (ROOT / "docs" / "how-to" / "find-the-place.md").read_text(encoding="utf-8")
    places = re.findall(r"`((?:opir_core|plugins|tests)/[\w/.]+)`", text)
    assert len(places) > 20
    assert not [place for place in places if not (ROOT / place).exists()]
