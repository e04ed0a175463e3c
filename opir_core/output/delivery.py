"""A run on its way out: windows through the scene's sinks, the truth into its own file, and what came of it."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from attrs import frozen

from opir_core.errors import SinkError
from opir_core.interfaces.contexts import EncoderContext, SinkContext
from opir_core.interfaces.protocols import Encoder, Sink, Transport
from opir_core.interfaces.records import Window
from opir_core.output.pump import PumpReport, SinkReport, pump
from opir_core.planning.plan import Plan, built
from opir_core.plugin.components import EventEncoder
from opir_core.scene.scene import Choice
from opir_core.simulation.manifest import run_manifest
from opir_core.simulation.run import plan_windows
from opir_core.simulation.summary import Tally


@frozen(eq=False)
class RunOutcome:
    """What came of a run: its summary, its manifest, and what each sink took."""

    summary: Mapping[str, Any]
    manifest: Mapping[str, Any]
    report: PumpReport

    def raise_for_failures(self) -> None:
        """Raise `SinkError` if any sink failed, with what each had delivered."""
        told = [
            f"{sink.error} ({sink.delivered} events delivered, {_kept(sink)}{sink.dropped} lost)"
            for sink in self.report.failures
        ]
        if told:
            raise SinkError("\n".join(told))


def _kept(sink: SinkReport) -> str:
    return f"{sink.spooled} spooled, " if sink.spooled else ""


def deliver(
    plan: Plan,
    *,
    truth_path: Path | None = None,
    tracks_path: Path | None = None,
    on_window: Callable[[Window], None] | None = None,
) -> RunOutcome:
    """Run a plan into the sinks of its scene and return what came of it; memory use does not grow with duration.

    `on_window` is called with each window once it is delivered. A failing sink does not stop the others. Raises
    `SinkError` where the truth or the tracks cannot be written; `RunOutcome.raise_for_failures` does for the sinks.
    """
    tally = Tally(plan)
    windows = tally.over(plan_windows(plan))
    if truth_path is not None:
        windows = _with_truth(plan, truth_path, windows)
    if tracks_path is not None:
        windows = _with_tracks(tracks_path, windows)
    report = pump(windows, _sinks(plan), on_window=on_window)
    return RunOutcome(tally.summary(), run_manifest(plan, tally.counts()), report)


def _with_truth(plan: Plan, path: Path, windows: Iterable[Window]) -> Iterator[Window]:
    from opir_core.output.truth_file import TruthFile

    with TruthFile(path, plan) as truth:
        for window in windows:
            truth.write(window)
            yield window


def _with_tracks(path: Path, windows: Iterable[Window]) -> Iterator[Window]:
    from opir_core.output.tracks_file import TracksFile

    with TracksFile(path) as tracks:
        for window in windows:
            tracks.write(window.tracks)
            yield window


def _sinks(plan: Plan) -> Mapping[str, Sink]:
    """Return the scene's sinks by their place in it, `outputs[0].jsonl`; where one cannot be had, none stays open."""
    with ExitStack() as opened:
        sinks: dict[str, Sink] = {}
        for choice in plan.scene.outputs:
            sinks[choice.path] = opened_sink(plan, choice)
            opened.callback(sinks[choice.path].close)
        opened.pop_all()
    return sinks


def opened_sink(plan: Plan, choice: Choice) -> Sink:
    """Return the sink of one of a scene's outputs, open."""
    make_encoder = partial(_encoder, plan, choice)
    context = SinkContext(make_encoder=make_encoder, scene_name=plan.scene.name, resumes=choice.spool is not None)
    made: Any = built(plan.host, choice, context)
    if choice.spool is None and not isinstance(made, Transport):
        sink: Sink = made
        return sink
    from opir_core.output.spool.opening import dispatched

    return dispatched(choice, made, make_encoder, plan.sensors)


def _encoder(plan: Plan, choice: Choice) -> Encoder:
    """Return the encoder that an output names with `encoder: NAME`."""
    component = plan.host.component(EventEncoder, getattr(choice.config, "encoder", "forge"), f"{choice.path}.encoder")
    context = EncoderContext(sensors=plan.sensors, epoch_us=plan.scene.epoch_us)
    encoder: Encoder = component.build(component.config(), context)
    return encoder
