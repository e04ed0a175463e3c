"""Documentation that cannot drift: every block marked `python` runs, every `console` block prints
what it shows.
"""

import ast
import inspect
import re
import subprocess
import sys
from importlib import import_module

import pytest
from peer_libraries import IMPORT, missing
from public_names import PUBLIC, is_public
from repository import ROOT

PAGES = sorted(
    [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "plugins").glob("*/README.md")]
)
#: Pages with blocks that run for a second and more, apart from those of the README.
LONG = {
    *("docs/explanation/imm.md", "docs/explanation/classification.md"),
    *(
        "docs/explanation/detection.md",
        "docs/explanation/kepler-arc.md",
        "docs/explanation/latency.md",
        "docs/how-to/score-tracks.md",
    ),
    *(
        "docs/how-to/report.md",
        "docs/how-to/serve.md",
        "docs/tutorials/fusion-pipeline.md",
        "docs/how-to/stone-soup.md",
        "docs/how-to/fit-a-prior.md",
        "docs/reference/event-extensions.md",
        "plugins/opir_stonesoup/README.md",
    ),
}
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
COMMAND = re.compile(r"^\$ (.*)$", re.MULTILINE)


def blocks(page, language):
    return [
        body for kind, body in FENCE.findall(page.read_text(encoding="utf-8")) if kind == language
    ]


def named(page):
    return str(page.relative_to(ROOT))


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    return tmp_path


def pages_with(language):
    """Return the pages that have blocks in a language, marked if these run for long."""
    pages = [page for page in PAGES if blocks(page, language)]
    return [
        pytest.param(page, id=named(page), marks=[pytest.mark.slow] * (named(page) in LONG))
        for page in pages
    ]


@pytest.mark.slow
@pytest.mark.parametrize("page", pages_with("python"))
def test_python_blocks_run(page, folder):
    code = "\n".join(blocks(page, "python"))
    absent = missing().intersection(IMPORT.findall(code))
    if absent:
        pytest.skip(f"it imports {', '.join(absent)}: pip install '.[peers]'")
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("page", pages_with("console"))
def test_console_blocks_print_what_they_show(page, folder):
    for block in blocks(page, "console"):
        words = COMMAND.split(block)
        for command, shown in zip(words[1::2], words[2::2], strict=True):
            assert printed(command, folder) == shown.strip(), command


def printed(command, folder):
    """Return what a command prints, as a user sees it: both streams, without trailing blanks."""
    done = subprocess.run(
        command,
        shell=True,
        cwd=folder,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        check=False,
    )
    return "\n".join(line.rstrip() for line in done.stdout.strip().splitlines())


def test_links_lead_somewhere():
    lost = [
        f"{named(page)}: {target}"
        for page in PAGES
        for target in re.findall(r"\]\((?!https?:|#)([^)#]+)", page.read_text(encoding="utf-8"))
        if not (page.parent / target).exists()
    ]
    assert not lost


@pytest.mark.slow
def test_generated_pages_are_fresh():
    done = subprocess.run(
        [sys.executable, ROOT / "docs" / "generate.py", "--check"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"run python docs/generate.py\n{done.stdout}{done.stderr}"


#: Distributions of which users import public names only.
OWN = (
    "opir_core",
    "opir_bench",
    "opir_coverage",
    "opir_estimation",
    "opir_photons",
    "opir_scoring",
    "opir_testing",
)
EXAMPLES = sorted((ROOT / "examples").rglob("*.py"))


def imported_names(code):
    """Yield package and name of what code imports from the core, and `opir.name` where the core
    goes by that name.
    """
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in OWN:
            yield from ((str(node.module), name.name) for name in node.names)
        elif isinstance(node, ast.Import):
            yield from (
                (name.name, "")
                for name in node.names
                if name.name.startswith("opir_core.") and name.name not in PUBLIC
            )
        elif (
            isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and node.value.id == "opir"
        ):
            yield "opir_core", node.attr


@pytest.mark.parametrize(
    "page", [*(page for page in PAGES if blocks(page, "python")), *EXAMPLES], ids=named
)
def test_pages_and_examples_import_only_public_names(page):
    code = (
        page.read_text(encoding="utf-8")
        if page.suffix == ".py"
        else "\n".join(blocks(page, "python"))
    )
    private = [
        f"{package}.{name}"
        for package, name in imported_names(code)
        if not is_public(package, name)
    ]
    assert not private


@pytest.mark.parametrize("package", sorted(PUBLIC))
def test_public_names_are_sorted_documented_and_there(package):
    door = import_module(package)
    assert list(door.__all__) == sorted(door.__all__)
    assert set(door.__all__) <= set(dir(door))
    undocumented = [
        name
        for name in door.__all__
        if (inspect.isclass(value := getattr(door, name)) or inspect.isroutine(value))
        and not value.__doc__
    ]
    assert not undocumented
