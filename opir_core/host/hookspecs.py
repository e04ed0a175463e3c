"""The hooks a plugin may implement.

Catalogue hooks (plural names) describe. The host calls each at most once, when a scene, `opir plugins` or `opir
describe` first needs to know what is offered; never while a simulation runs, and not at all for a plugin that
`OPIR_PLUGINS` leaves out or that nothing asked for. A hook takes no arguments and returns an iterable, which the host
exhausts at once; what it yields is sorted by name, so the order of installation, of entry points and of yielding has no
effect. Two owners of one name are refused, with both named. `tryfirst`, `trylast`, wrappers and `firstresult` have no
meaning here and are refused.

A hook must not import anything heavy, touch the network, the clock or global random state, or print. An exception from
a hook is reported against the plugin that raised it and costs only that plugin's components.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import pluggy

if TYPE_CHECKING:
    from opir_core.host import components as c
    from opir_core.scene.target_classes import TargetClass

PROJECT = "opir"

hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


class CatalogueHooks:
    """Hooks that say what a plugin has."""

    @hookspec
    def opir_constellations(self) -> Iterable[c.Constellation]:  # type: ignore[empty-body]
        """Yield named fleets: satellites, their orbits and the sensor model they carry.

        A scene chooses one with `constellation: NAME`. The model named need not come from the same plugin.
        """

    @hookspec
    def opir_sensor_models(self) -> Iterable[c.SensorModel]:  # type: ignore[empty-body]
        """Yield sensor models: when a sensor looks, what it sees, in which bands, how noisily.

        A scene chooses one with `model: NAME` in a sensor's block.
        """

    @hookspec
    def opir_detection_models(self) -> Iterable[c.DetectionModel]:  # type: ignore[empty-body]
        """Yield detection models: exposures to probability of detection. A scene chooses one with `detection: NAME`."""

    @hookspec
    def opir_confidence_models(self) -> Iterable[c.ConfidenceModel]:  # type: ignore[empty-body]
        """Yield confidence models: detections and their history to confidence. Chosen with `confidence: NAME`."""

    @hookspec
    def opir_classifiers(self) -> Iterable[c.ClassifierModel]:  # type: ignore[empty-body]
        """Yield classifiers: measurements to the reported target type. Chosen with `classification: NAME`."""

    @hookspec
    def opir_trackers(self) -> Iterable[c.TrackerModel]:  # type: ignore[empty-body]
        """Yield trackers: detections to tracks. Chosen with `tracker: NAME`.

        A tracker sees detections only, never truth.
        """

    @hookspec
    def opir_target_models(self) -> Iterable[c.TargetModel]:  # type: ignore[empty-body]
        """Yield target models: launches to trajectories and plumes. Chosen with `model: NAME` in a target's block."""

    @hookspec
    def opir_target_classes(self) -> Iterable[TargetClass]:  # type: ignore[empty-body]
        """Yield target classes: boost profiles, what follows burnout, plumes. Chosen with `type: NAME` in a target."""

    @hookspec
    def opir_signature_models(self) -> Iterable[c.SignatureModel]:  # type: ignore[empty-body]
        """Yield signature models: how brightly targets radiate. Chosen with `signature: NAME` in a target's block."""

    @hookspec
    def opir_source_models(self) -> Iterable[c.SourceModel]:  # type: ignore[empty-body]
        """Yield source models: emitters that are no targets. Chosen with `model: NAME` in a block of `sources`."""

    @hookspec
    def opir_atmosphere_models(self) -> Iterable[c.AtmosphereModel]:  # type: ignore[empty-body]
        """Yield atmosphere models: a path to in-band transmittance. Chosen with `atmosphere: NAME`."""

    @hookspec
    def opir_background_models(self) -> Iterable[c.BackgroundModel]:  # type: ignore[empty-body]
        """Yield background models: background radiance and clutter. Chosen with `background: NAME`."""

    @hookspec
    def opir_event_encoders(self) -> Iterable[c.EventEncoder]:  # type: ignore[empty-body]
        """Yield event encoders: detections to message bytes. Chosen with `encoder: NAME` in an output's block."""

    @hookspec
    def opir_sinks(self) -> Iterable[c.SinkModel]:  # type: ignore[empty-body]
        """Yield sinks: where events go. Chosen with `- NAME: {...}` under `outputs`."""

    @hookspec
    def opir_renderers(self) -> Iterable[c.RendererModel]:  # type: ignore[empty-body]
        """Yield renderers: columns to the lines of events and truth. All make the same bytes.

        The environment variable `OPIR_RENDERER` names one; by default it is `compiled` if that is installed and works,
        else `reference`.
        `render(count, columns)` returns `count` lines. A column is text common to all lines (`bytes`), or has
        `plain()`, which returns a tuple of its kind and its values:

        * `("looked", texts, row)`: the text of each line by its row (n,); row None: `texts` (n,) are those of the lines
        * `("decimal", values, decimals)`: numbers (n,), rounded, as the shortest text of the double; nan, inf: `null`
        * `("ids", words)`: UUIDs from two 64-bit words (n, 2), the most significant first
        * `("times", unix_us)`: UTC (n,), µs since 1970-01-01, as `2026-04-01T12:00:00.050000Z`

        Example::

            >>> from opir_core.plugin import Host, RendererModel, hookimpl
            >>> class Plugin:
            ...     @hookimpl
            ...     def opir_renderers(self):
            ...         yield RendererModel(name="traced", summary="the reference", build=traced)
            >>> def traced(config, context):
            ...     return lambda count, columns: context.reference(count, columns)
            >>> Host.of(Plugin()).names("opir_renderers")
            ['reference', 'traced']
        """

    @hookspec
    def opir_metrics(self) -> Iterable[c.MetricModel]:  # type: ignore[empty-body]
        """Yield metrics: figures of finished runs. A study chooses them by name under `metrics`."""

    @hookspec
    def opir_executors(self) -> Iterable[c.ExecutorModel]:  # type: ignore[empty-body]
        """Yield executors: where the runs of a study are made. A study chooses one with `executor: NAME`."""

    @hookspec
    def opir_exporters(self) -> Iterable[c.ExporterModel]:  # type: ignore[empty-body]
        """Yield exporters: formats of other programs. `opir export RUN --to NAME` chooses one."""

    @hookspec
    def opir_run_views(self) -> Iterable[c.RunView]:  # type: ignore[empty-body]
        """Yield run views: a finished run in another form, tables or plots for instance. `run.view(NAME)` returns one.

        `build(run)` gets an `opir_core.Run` and changes nothing of it. `run.plot`, `run.tables()`, `run.to_pandas()`
        and `run.to_polars()` return the views `plot`, `tables`, `pandas` and `polars`; a notebook shows the view `map`,
        an element of HTML or SVG as text. An allow-list of the host that the run was made with also applies to views.

        Example::

            >>> from opir_core.plugin import Host, RunView, hookimpl
            >>> class Plugin:
            ...     @hookimpl
            ...     def opir_run_views(self):
            ...         yield RunView(name="seen", summary="how many targets are detected", build=seen)
            >>> def seen(run):
            ...     return sum(target["detections"] > 0 for target in run.summary["targets"])
            >>> Host.of(Plugin()).component("opir_run_views", "seen").summary
            'how many targets are detected'
        """


class ExtensionHooks:
    """Hooks that add to the command line."""

    @hookspec
    def opir_add_commands(self, commands: Any) -> None:
        """Add commands to the `opir` command line.

        `commands` is argparse's object of subparsers. Called when the command line is asked for a command that the core
        does not have, or for its help; not when a core command runs. A parser added must set `run` as a default:
        `parser.set_defaults(run=function)`, where `function(arguments) -> int` returns the exit code.
        """
