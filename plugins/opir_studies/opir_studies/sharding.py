"""Studies on machines that share no network: each makes a shard of the runs, and the parts are
merged.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from opir_core.errors import BAD_DATA, reason_of
from opir_core.host import DEAD_AFTER_S
from opir_core.output import OutputFiles
from opir_core.plugin import ExecutorContext
from opir_studies.parts import copy_parts
from opir_studies.planning import planned_study
from opir_studies.refusals import refusal
from opir_studies.result import StudyResult, made_of
from opir_studies.study import Study, study_of_keys
from opir_studies.sweeping import Shard, StudyProgress, SweepState, sweep

#: What a shard's folder holds besides its parts: the study that it is of.
SHARD = "shard.json"


def sweep_shard(
    study: Study,
    folder: str | Path,
    shard: Shard,
    *,
    workers: int | None = None,
    dead_after_s: float = DEAD_AFTER_S,
    on_progress: Callable[[StudyProgress], None] = lambda _progress: None,
) -> int:
    """Make a shard of a study's runs into a folder; return the number of its runs. Runs that are
    there already are not made again.

    Raises as `sweep`, and `SceneError` for a study that stops early: no shard knows when.
    """
    if study.until:
        words = "a shard does not know when the whole study may stop; leave it out"
        raise refusal("until", words, f"study {study.study}")
    place = Path(folder)
    planned = planned_study(study)
    context = ExecutorContext(workers=workers, dead_after_s=dead_after_s)
    state = SweepState.of(planned, place, context, on_progress, shard)
    text = json.dumps({"made_of": made_of(study), "shard": [shard.place + 1, shard.count]})
    with OutputFiles() as files:
        files.make_folder(place, parents=True, is_made_up=True)
        files.write(place / SHARD, text.encode(), "shard's", is_made_up=True)
    state.finished_run()
    state.require_no_failure()
    return state.done


def merged(
    folders: Sequence[str | Path],
    folder: str | Path,
    *,
    workers: int | None = None,
    on_progress: Callable[[StudyProgress], None] = lambda _progress: None,
) -> StudyResult:
    """Merge the shards of a study into a folder and return its result, the same bytes as those of
    one machine.

    Runs that no shard has are made here. Raises `SceneError` for shards of different studies.
    """
    definitions = [_definition(Path(shard)) for shard in folders]
    for other, definition in zip(folders[1:], definitions[1:], strict=True):
        if definition != definitions[0]:
            raise refusal("", f"is a shard of another study than {folders[0]}", str(other))
    study = study_of_keys(definitions[0], str(folders[0]))
    for shard in folders:
        copy_parts(Path(shard), Path(folder))
    return sweep(study, folder, workers=workers, on_progress=on_progress)


def _definition(folder: Path) -> dict[str, Any]:
    try:
        contents = json.loads((folder / SHARD).read_text(encoding="utf-8"))
        return dict(contents["made_of"])
    except (OSError, *BAD_DATA) as error:
        reason = reason_of(error) if isinstance(error, OSError) else "its shard.json is damaged"
        words = f"is no shard of a study: {reason}; `opir sweep --shard I/N` makes one"
        raise refusal("", words, str(folder)) from error
