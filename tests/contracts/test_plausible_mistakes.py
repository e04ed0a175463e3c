"""`opir check` finds the mistakes that authors of plugins make, and tells each cause once."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from opir_testing.contracts import HOMES
from plausible_mistakes import MISTAKES, mistaken_package
from repository import ROOT

from opir_core.plugin import Host

#: Of 30 mistakes at least 28 are found.
LEAST_SHARE = 28 / 30

#: Mistakes that fail tests of several kinds, and the most causes that `opir check` prints for each.
SEVERAL = {
    "counts that are truth": 2,
    "file that is never closed": 2,
    "global random numbers": 2,
    "learns while it associates": 2,
    "lost message": 2,
    "windows counted as events": 3,
}

NUMBERS = {name: number for number, name in enumerate(MISTAKES)}
FOUND = [name for name, mistake in MISTAKES.items() if mistake.words]


def checked(name: str, folder: Path) -> subprocess.CompletedProcess[str]:
    package = mistaken_package(NUMBERS[name], MISTAKES[name], folder, Host.discover())
    return subprocess.run(
        [sys.executable, "-m", "opir_core", "check", package],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), *sys.path])},
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


def test_most_of_many_mistakes_of_most_kinds_are_found() -> None:
    """What is called found is held by the tests below, mistake by mistake."""
    assert len(MISTAKES) >= 40
    assert len(FOUND) >= LEAST_SHARE * len(MISTAKES)
    assert len({mistake.kind for mistake in MISTAKES.values()}) >= 0.7 * len(HOMES)
    page = (ROOT / "docs" / "explanation" / "plugins.md").read_text(encoding="utf-8")
    assert f"Of {len(MISTAKES)} mistakes" in page
    assert f"it finds\n{len(FOUND)}, all but six" in page
    assert all(mistake.missed for name, mistake in MISTAKES.items() if name not in FOUND)


@pytest.mark.slow
@pytest.mark.parametrize("name", FOUND)
def test_a_mistake_is_found_and_its_cause_is_told_once(name: str, tmp_path: Path) -> None:
    done = checked(name, tmp_path)
    assert MISTAKES[name].words in done.stdout + done.stderr
    is_implausible = "is outside the plausible" in done.stderr
    assert done.returncode in ((0,) if is_implausible else (3, 4))
    if done.returncode == 4:
        causes = done.stdout.count("\n  failed ")
        assert re.search(rf"; {causes} causes? to correct$", done.stdout.strip())
        assert 1 <= causes <= SEVERAL.get(name, 1)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in MISTAKES if name not in FOUND])
def test_what_is_called_missed_is_missed(name: str, tmp_path: Path) -> None:
    assert checked(name, tmp_path).returncode == 0
