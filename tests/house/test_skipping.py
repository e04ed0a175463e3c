"""A scene pays only for what it names: each optional part is imported by a scene that names it, and by no other.

What is not imported is not called and allocates nothing.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from repository import EXAMPLES

from opir_core.planning.plan import compile_plan
from opir_core.plugin.host import Host
from opir_core.scene.reading import scene_from_mapping
from opir_core.simulation.explanation import explained
from opir_core.simulation.run import run_of_plan

SCENE = str(EXAMPLES / "first_light.yaml")

#: Optional parts: what names them on the command line, and modules that only they need.
PARTS = {
    "radiometry": (("--set", "detection=snr"), ("opir_core.radiometry", "opir_core.detection.snr", "scipy.special")),
    "false alarms": (("--set", "detection=snr"), ("opir_core.simulation.false_alarms",)),
    "interpolated P_d": (("--set", "detection=snr"), ("opir_core.simulation.interpolation",)),
    "atmosphere, clouds": (
        ("--set", "detection=snr", "--set", "atmosphere=lowtran"),
        ("opir_core.radiometry.lowtran", "opir_core.radiometry.clouds"),
    ),
    "background": (
        ("--set", "detection=snr", "--set", "background=earth"),
        ("opir_core.radiometry.earth", "opir_core.radiometry.sea_surface"),
    ),
    "tracker": (("--tracker", "imm"), ("opir_trackers", "opir_core.estimation.motion", "opir_core.output.tracks_file")),
    "forces": (("--set", "forces=[j2]"), ("opir_core.flight.integration", "opir_core.flight.dop853")),
    "encoder forge-c2": (
        ("--set", "outputs=[{jsonl: {path: other.jsonl, encoder: forge-c2}}]"),
        ("opir_core.output.events.forge_c2",),
    ),
    "encoder udl": (
        ("--set", "outputs=[{jsonl: {path: other.jsonl, encoder: udl}}]"),
        ("opir_core.output.events.udl",),
    ),
}
#: Parts that no word of a scene run by `opir run` names.
NEVER = (
    "opir_report",
    "opir_export",
    "opir_http",
    "opir_kafka",
    "opir_studies",
    "opir_sbirs",
    "opir_nextgen",
    "opir_leo",
)


def modules(folder: Path, *words: str) -> set[str]:
    """Return the modules that a process has imported after a run."""
    code = (
        "import json, sys\nfrom opir_core.cli.main import main\n"
        f"code = main(['run', {SCENE!r}, '--quiet', *{list(words)!r}])\nassert not code, code\n"
        "print(json.dumps(sorted(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=True)
    return set(json.loads(done.stderr.splitlines()[-1]))


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    return modules(tmp_path_factory.mktemp("plain"))


@pytest.mark.parametrize("part", sorted(PARTS))
def test_what_a_scene_does_not_name_is_not_imported(part: str, plain: set[str]) -> None:
    assert not plain & set(PARTS[part][1])
    assert not {name for name in plain if name.split(".")[0] in NEVER}


@pytest.mark.slow
@pytest.mark.parametrize("part", sorted(PARTS))
def test_what_a_scene_names_is_imported(part: str, plain: set[str], tmp_path: Path) -> None:
    words, needed = PARTS[part]
    loaded = modules(tmp_path, *words)
    assert set(needed) <= loaded
    others = {name for other, (named, names) in PARTS.items() if named != words for name in names}
    if part in {"forces", "encoder forge-c2"}:
        assert not loaded & (others - set(needed))


def test_the_work_of_a_plan_is_counted_with_what_it_skips_and_why() -> None:
    sensors = [{"model": "DSP", "id": f"S{slot}", "orbital_slot_deg": float(slot)} for slot in (-135, 45, -60)]
    launch = {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 10.0}
    mapping = {
        "scene": "skipped",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 120,
        "sensors": sensors,
        "targets": [{"id": "T", "type": "ICBM", "launch": launch, "aim": {"lat_deg": 9.0, "lon_deg": 167.7}}],
    }
    host = Host.discover(["dsp"])
    plan = compile_plan(scene_from_mapping(mapping, host=host), host)
    work = explained(plan)["work"]
    assert work == run_of_plan(plan).summary["work"]
    assert work["pairs"] == 3
    assert work["pairs_skipped"] == {"behind_earth": 1}
    assert work["looks"] == work["looks_visible_throughout"] + work["looks_tested_for_visibility"] > 0
    assert json.loads(json.dumps(work)) == work
