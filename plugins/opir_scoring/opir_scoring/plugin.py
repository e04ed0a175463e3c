"""The command `opir score`; what computes scores is imported when the command is given."""

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from opir_core.plugin import RunView, deferred, hookimpl


@hookimpl
def opir_run_views() -> Iterable[RunView]:
    """Yield `score`."""
    yield RunView(
        name="score",
        summary="a function that scores the tracks of a run, which `run.score()` calls",
        build=_scores,
    )


def _scores(run: Any) -> Callable[..., Any]:
    from opir_scoring.scorecards import scorecard_of_run

    return partial(scorecard_of_run, run)


@hookimpl
def opir_add_commands(commands: Any) -> None:
    """Add `opir score`."""
    from opir_scoring.arguments import score_arguments

    parser = commands.add_parser("score", help="score the tracks of a run against the truth")
    score_arguments(parser)
    parser.set_defaults(run=deferred("opir_scoring.command.score"), group="look")
