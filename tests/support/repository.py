"""Folders of this repository."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
#: Scenes that tests run and nobody else reads.
TEST_SCENES = ROOT / "tests" / "scenes"
DATA = ROOT / "tests" / "data"
