"""Spools and the files behind them through power cuts: nothing that counts as kept is lost, and no
file is damaged.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from power_cuts import can_record, power_cuts, record
from spool_sessions import SPOOL, ids_in, left, spooled_after
from spool_transports import ENCODER, SENSORS, filled_spool, window

from opir_core.output.spool.batches import EncodedBatcher
from opir_core.output.spool.salvage import salvage, salvaged_at_start

#: Power cuts of each recording in the slow tests; in the quick ones a few.
CUTS = int(os.environ.get("OPIR_POWER_CUTS", "1000"))
FEW = 30
#: How long a recorded session lasts, s.
LONG_S = 6.0
SHORT_S = 1.0
#: Longest time, s, for which a power cut may undo what a spool without `survives_power_cut` has
#: taken.
UNDONE_S = 1.0

pytestmark = pytest.mark.skipif(not can_record(), reason="needs Linux and a C compiler")

FILL = "import runpy, sys; runpy.run_module('spool_sessions', run_name='__main__')"
SALVAGE = (
    "import sys; from opir_core.output.spool.salvage import salvage; assert salvage(sys.argv[1]) is"
    " not None"
)
FINISH = (
    "import pathlib, sys; from opir_core.output.spool.salvage import finish_salvage as f;"
    " f(pathlib.Path(sys.argv[1]))"
)
#: Leaves a spool with a damaged batch, its log not merged, as a killed process does.
DAMAGE = """
import os, sys
from opir_core.output.spool.journal import Journal
journal = Journal(sys.argv[1], 1 << 26)
journal._database.execute("UPDATE parcel SET body = x'00' WHERE number = 3")
os._exit(0)
"""


def filled(tmp_path, kind, *, survives, seconds):
    disk = tmp_path / "disk"
    disk.mkdir()
    return record(disk, FILL, tmp_path, disk, kind, survives, seconds)


def require_kept(tmp_path, kind, *, survives, seconds, cuts):
    """Fail if a cut damages or loses more than it may; return the most events lost, and from how
    long before, s.
    """
    loss_s = 0
    longest_s = 0.0
    for cut in power_cuts(filled(tmp_path, kind, survives=survives, seconds=seconds), range(cuts)):
        result = left(cut, cut.make(tmp_path / "cut"), kind)
        where = f"cut {cut.seed} after call {cut.calls}"
        assert result.lost_s <= (0.0 if survives else UNDONE_S), (
            f"{where}: {len(result.lost)} events lost"
        )
        loss_s = max(loss_s, len(result.lost))
        longest_s = max(longest_s, result.lost_s)
    return loss_s, longest_s


@pytest.mark.parametrize("kind", ["held", "jsonl"])
def test_a_power_cut_takes_nothing_from_a_spool_that_survives_it(tmp_path, kind):
    assert require_kept(tmp_path, kind, survives=True, seconds=SHORT_S, cuts=FEW) == (0, 0.0)


@pytest.mark.slow
@pytest.mark.timeout(100 + CUTS)
@pytest.mark.parametrize("survives", [True, False])
@pytest.mark.parametrize("kind", ["held", "jsonl"])
def test_a_power_cut_takes_at_most_the_last_second_from_a_spool(tmp_path, kind, survives):
    loss_s, _ = require_kept(tmp_path, kind, survives=survives, seconds=LONG_S, cuts=CUTS)
    assert survives or loss_s > 0


def damaged(disk):
    """Make a damaged spool in a folder, and return the ids of its whole batches."""
    disk.mkdir()
    filled_spool(disk / SPOOL, 6, 20)
    subprocess.run([sys.executable, "-c", DAMAGE, str(disk / SPOOL)], check=True)
    assert (disk / f"{SPOOL}-wal").exists()
    batches = [
        next(EncodedBatcher(ENCODER, SENSORS).batches(window(20, 20 * number)))
        for number in range(6)
    ]
    return {name for number, batch in enumerate(batches) if number != 2 for name in ids_in(batch)}


def cut_off(disk):
    """Make of a damaged spool what a power cut leaves before its end: the new spool is ready, the
    old one has a log.
    """
    copy = Path(shutil.copytree(disk, disk.with_name("copy")))
    salvage(copy / SPOOL)
    shutil.copy(copy / SPOOL, disk / f"{SPOOL}.salvaged")


@pytest.mark.parametrize("program", [SALVAGE, FINISH], ids=["begun", "finished"])
@pytest.mark.parametrize(
    "cuts", [3 * FEW, pytest.param(CUTS, marks=[pytest.mark.slow, pytest.mark.timeout(100 + CUTS)])]
)
def test_a_power_cut_while_a_spool_is_salvaged_loses_no_whole_batch(tmp_path, program, cuts):
    disk = tmp_path / "disk"
    total = damaged(disk)
    if program == FINISH:
        cut_off(disk)
    for cut in power_cuts(record(disk, program, tmp_path, disk / SPOOL), range(cuts)):
        place = cut.make(tmp_path / "cut")
        where = f"cut {cut.seed} after call {cut.calls}: {sorted(cut.tree)}"
        salvaged_at_start(place / SPOOL)
        assert spooled_after(place) >= total, where
