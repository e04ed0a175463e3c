"""Batch runs: windows into the scene's sinks, truth and tracks into files of their own."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from attrs import evolve, frozen

from opir_core.errors import PluginError, SinkError
from opir_core.host.boundary import check_hint, owner_text
from opir_core.host.components import EventEncoder, SinkModel
from opir_core.host.host import Host
from opir_core.host.watchdog import limit_in_force
from opir_core.interfaces.contexts import EncoderContext, FilePlacement, SinkContext
from opir_core.interfaces.outputs import Encoder, Sink, Transport, sink_or_transport
from opir_core.interfaces.records import Window
from opir_core.output.events.encoder_input import detection_count, track_count
from opir_core.output.pump import PumpReport, SinkReport, pump
from opir_core.output.sink_thread import Counter
from opir_core.output.transaction import OutputFiles
from opir_core.planning.built_parts import built
from opir_core.planning.plan import Plan
from opir_core.scene.scene import Choice
from opir_core.simulation.manifest import run_manifest
from opir_core.simulation.run import plan_windows
from opir_core.simulation.summary import Tally

if TYPE_CHECKING:
    from opir_core.output.shared_output import SharedOutput

#: Time, s, that a call of a plugin's sink may last in a batch run, unless `--dead-after` says
#: otherwise.
CALL_S = 30.0
#: The ending of a file with columns.
PARQUET = ".parquet"


def has_columns(path: Path) -> bool:
    """Return whether a path is that of a file with columns: whether it ends in `.parquet`, in
    letters of any case.
    """
    return path.suffix.casefold() == PARQUET


@frozen(eq=False)
class RunOutcome:
    """Summary, manifest and sink reports of a run."""

    summary: Mapping[str, Any]
    manifest: Mapping[str, Any]
    report: PumpReport
    #: Temporary files of a run one of whose files failed; the files of the run before are
    #: unchanged.
    incomplete: tuple[Path, ...] = ()

    def raise_for_failures(self) -> None:
        """Raise `SinkError` if any sink failed, with its event counts."""
        failures = [
            f"{sink.error} ({sink.delivered} events delivered, {_spooled(sink)}{sink.dropped} lost)"
            for sink in self.report.failures
        ]
        if self.incomplete:
            names = ", ".join(map(str, self.incomplete))
            failures.append(
                f"no file of an earlier run is replaced; what was written is in {names}"
            )
        if failures:
            raise SinkError("\n".join(failures))


def _spooled(sink: SinkReport) -> str:
    return f"{sink.spooled} spooled, " if sink.spooled else ""


def deliver(
    plan: Plan,
    *,
    truth_path: Path | None = None,
    tracks_path: Path | None = None,
    commands_path: Path | None = None,
    manifest_path: Path | None = None,
    made_up: Collection[Path | None] = (),
    on_window: Callable[[Window], None] | None = None,
    workers: int = 1,
    windows: Iterable[Window] | None = None,
    inputs: Sequence[Mapping[str, Any]] = (),
) -> RunOutcome:
    """Run a plan into the sinks of its scene and return the outcome; memory use does not grow with
    duration.

    The files of the run are put in place together, once it is whole, the manifest last; a run that
    is interrupted, or in which a file fails, leaves those that were there. `on_window` is called
    with each window after the sinks. `made_up` are those of the paths that no user gave: no link,
    device or pipe is written to under these names. `workers` is the number of processes that
    compute and encode the windows; it changes no byte. `windows` replace those of the plan, and
    `inputs` are the files that they are from, for the manifest. A failing sink does not stop the
    others. Raises `SinkError` if truth, tracks or manifest cannot be written, or another run writes
    one of the files; for the sinks, `RunOutcome.raise_for_failures` does.
    """
    tally = Tally(plan)
    is_shared = workers != 1 and plan.has_independent_windows
    shared = _shared(plan, workers, needs_columns=on_window is not None) if is_shared else None
    windows = tally.over(windows or (plan_windows(plan) if shared is None else shared.windows()))
    files = OutputFiles(manifest_path, is_made_up=manifest_path in made_up)
    try:
        staged: dict[str, bool] = {}
        sinks = _sinks(plan, files, staged)
        with ExitStack() as closing:
            for sink in sinks.values():
                closing.callback(sink.close)
            paths = truth_path, tracks_path, commands_path
            if any(path is not None for path in paths):
                place = partial(_placed, files, made_up)
                windows = _recorded(plan, windows, place, *paths, shared)
            closing.pop_all()
        if shared is not None:
            sinks = {path: shared.sink(path, sink) for path, sink in sinks.items()}
        counts = {choice.path: counter_of(plan, choice) for choice in plan.scene.outputs}
        report = pump(windows, sinks, on_window=on_window, counts=counts)
    except BaseException:
        files.abandon()
        raise
    manifest = {
        **run_manifest(plan, tally.counts(), tally.steering.commands),
        "sensor_health": tally.health,
    }
    return _outcome(
        plan, tally, report, files, staged, {**manifest, "files": [*manifest["files"], *inputs]}
    )


def _outcome(
    plan: Plan,
    tally: Tally,
    report: PumpReport,
    files: OutputFiles,
    is_staged: Mapping[str, bool],
    manifest: Any,
) -> RunOutcome:
    """Put the files of a run in place, unless one of them failed, and return the outcome."""
    if files.parts:  # a run without files has no text, and needs no renderer
        manifest["renderer"], _ = _renderer(plan.host)
    if any(is_staged[sink.name] for sink in report.failures):
        incomplete = tuple(files.parts)
        files.keep()
        return RunOutcome(tally.summary(), manifest, report, incomplete)
    return RunOutcome(tally.summary(), files.commit(manifest), report)


def _shared(plan: Plan, workers: int, *, needs_columns: bool) -> "SharedOutput":
    from opir_core.output.shared_output import SharedOutput  # a run in one process does not load it

    return SharedOutput(plan, workers, needs_columns=needs_columns)


def _recorded(
    plan: Plan,
    windows: Iterable[Window],
    place: Callable[..., Path],
    truth_path: Path | None,
    tracks_path: Path | None,
    commands_path: Path | None,
    shared: "SharedOutput | None",
) -> Iterator[Window]:
    """Yield windows after their truth, tracks and commands are written to files."""
    with ExitStack() as opened:
        truth = None
        if truth_path is not None:
            file = opened.enter_context(_truth_file(plan, place, truth_path))
            truth = file if shared is None else shared.truth(file)
        tracks = None
        if tracks_path is not None:
            from opir_core.output.tracks_file import (
                TracksFile,
            )  # a run without a tracker does not load it

            at = place(tracks_path, only_appends=True, kind="tracks")
            tracks = opened.enter_context(TracksFile(at, plan.hypothesis_names))
        commands = None
        if commands_path is not None:
            from opir_core.output.run_files import CommandsFile

            at = place(commands_path, only_appends=True, kind="commands")
            commands = opened.enter_context(CommandsFile(at))
        for window in windows:
            if truth is not None:
                truth.write(window)
            if tracks is not None:
                tracks.write(window.tracks)
            if commands is not None:
                commands.write(window.commands)
            yield window


def _placed(files: OutputFiles, made_up: Collection[Path | None], path: Path, **how: Any) -> Path:
    return files.stage(path, is_made_up=path in made_up, **how)


def _truth_file(plan: Plan, place: Callable[..., Path], path: Path) -> Any:
    """Return the file of a run's truth, open: columns for a path that ends in `.parquet`, else
    lines.

    Raises `PluginError` if no plugin writes columns.
    """
    from opir_core.output.run_files import TruthFile, truth_records

    if not has_columns(path):
        return TruthFile(place(path, only_appends=True, kind="truth"), plan)
    opened = columns_sink(plan.host, "open_truth", f"a truth file with the ending {PARQUET}")
    return opened(path, place(path, kind="truth"), plan.targets.ids, truth_records(plan))


def columns_sink(host: Host, ability: str, purpose: str) -> Callable[..., Any]:
    """Return a function of the sink `parquet`, its field `ability`; `purpose` begins the message
    where it is missing.

    Raises `PluginError` if the sink is not installed or has no such function.
    """
    name = PARQUET.removeprefix(".")
    function: Callable[..., Any] | None = getattr(host.component(SinkModel, name, purpose), ability)
    if function is None:
        raise PluginError(
            f"{purpose}: the sink {name!r} of {host.provenance(SinkModel, name)} has no {ability}"
        )
    return function


def _sinks(plan: Plan, files: OutputFiles, is_staged: dict[str, bool]) -> Mapping[str, Sink]:
    """Return the scene's sinks, open, by their path in it, `outputs[0].jsonl`; if one cannot be
    opened, none is.

    Sets `is_staged` of each path to whether the sink writes a file of the run.
    """
    with ExitStack() as opened:
        sinks: dict[str, Sink] = {}
        for choice in plan.scene.outputs:
            count = len(files.parts)
            sinks[choice.path] = opened_sink(plan, choice, files.stage)
            opened.callback(sinks[choice.path].close)
            is_staged[choice.path] = len(files.parts) > count
        opened.pop_all()
    return sinks


def opened_sink(
    plan: Plan, choice: Choice, stage: FilePlacement | None = None, *, is_checked: bool = True
) -> Sink:
    """Return the sink of a scene's output, open; `stage` as in `SinkContext`.

    Unless it is not to be checked, a plugin's sink is behind the boundary of `checked_parts`.
    """
    make_encoder = partial(_encoder, plan, choice)
    context = SinkContext(
        make_encoder=make_encoder,
        scene_name=plan.scene.name,
        resumes=choice.spool is not None,
        count=counter_of(plan, choice),
        origin=_origin(plan),
        **({} if stage is None else {"stage": stage}),
    )
    owner = partial(owner_text, plan.host, choice)
    product = sink_or_transport(built(plan.host, choice, context), owner)
    if choice.spool is None and not isinstance(product, Transport):
        if not is_checked or _is_of_core(plan.host.component(choice.hook, choice.name)):
            return product
        from opir_core.output.checked_parts import CheckedSink

        return CheckedSink(
            product,
            owner,
            check_hint(choice.name),
            None if stage is None else limit_in_force(CALL_S),
        )
    from opir_core.output.spool.columns import Origin
    from opir_core.output.spool.opening import transport_sink

    origin = Origin(plan.scene.epoch_us, plan.sensors, plan.reported_types, plan.hypothesis_names)
    return transport_sink(choice, product, make_encoder, origin)


def counter_of(plan: Plan, choice: Choice) -> Counter:
    """Return the function that counts a window's events for an output: detections, or tracks if it
    encodes these.
    """
    return track_count if _encoder_model(plan, choice).encodes_tracks else detection_count


def _encoder_model(plan: Plan, choice: Choice) -> EventEncoder:
    """Return the component of the encoder of an output, `encoder: NAME`."""
    return plan.host.component(
        EventEncoder, getattr(choice.config, "encoder", "forge"), f"{choice.path}.encoder"
    )


def _renderer(host: Host) -> tuple[Any, Any]:
    """Return the name of the renderer that is used, and the renderer."""
    from opir_core.output.events.rendering import chosen_renderer

    return chosen_renderer(host)


def _encoder(plan: Plan, choice: Choice) -> Encoder:
    """Return the encoder of an output."""
    component = _encoder_model(plan, choice)
    encoder_choice = Choice(component.hook, component.name, None, f"{choice.path}.encoder")
    _, render = _renderer(plan.host)
    owner = partial(owner_text, plan.host, encoder_choice)
    context = evolve(_origin(plan), render=render)
    encoder = Encoder.adopt(built(plan.host, encoder_choice, context, component.config()), owner)
    if _is_of_core(component):
        return encoder
    from opir_core.output.checked_parts import CheckedEncoder

    return CheckedEncoder(encoder, owner, check_hint(component.name))


def _origin(plan: Plan) -> EncoderContext:
    return EncoderContext(
        sensors=plan.sensors,
        epoch_us=plan.scene.epoch_us,
        reported_types=plan.reported_types,
        hypotheses=plan.hypothesis_names,
        paths=plan.link_paths,
    )


def _is_of_core(component: Any) -> bool:
    """Return whether a component's parts are the core's own, which need no boundary."""
    build = getattr(component.build, "func", component.build)
    return str(getattr(build, "__module__", "")).partition(".")[0] == "opir_core"
