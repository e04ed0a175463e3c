"""The hooks a plugin may implement.

Catalogue hooks (plural names) describe. The host calls each at most once, when a scene, `opir
plugins` or `opir describe` first needs to know what is offered; never while a simulation runs, and
not at all for a plugin that `OPIR_PLUGINS` leaves out or that nothing asked for. A hook takes no
arguments and returns an iterable, which the host exhausts at once; what it yields is sorted by
name, so the order of installation, of entry points and of yielding has no effect. Two owners of one
name are refused, with both named. `tryfirst`, `trylast`, wrappers and `firstresult` have no meaning
here and are refused.

A hook must not import anything heavy, touch the network, the clock or global random state, or
print. An exception from a hook is reported against the plugin that raised it and costs only that
plugin's components.
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

        A scene chooses one with `constellation: NAME`. The model named need not come from the same
        plugin.

        >>> from opir_core.plugin import Constellation, Host, hookimpl
        >>> SATELLITES = [{"id": f"PAIR-{slot}", "orbital_slot_deg": slot} for slot in (10.0, 40.0)]
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_constellations(self):
        ...         yield Constellation(name="PAIR", summary="two DSP satellites", model="DSP", satellites=SATELLITES)
        >>> Host.of(Plugin()).component(Constellation, "PAIR").satellites[1]
        {'id': 'PAIR-40.0', 'orbital_slot_deg': 40.0}
        """

    @hookspec
    def opir_sensor_models(self) -> Iterable[c.SensorModel]:  # type: ignore[empty-body]
        """Yield sensor models: when a sensor looks, what it sees, in which bands, how noisily.

        A scene chooses one with `model: NAME` in a sensor's block.

        >>> from opir_core.plugin import Host, ScanningSensorConfig, SensorModel, hookimpl
        >>> from opir_core.plugin import scanning_model, with_defaults
        >>> @with_defaults(bands={"SWIR": (2.5, 3.0)}, scan_period_ms=5000.0, detection_probability={"ICBM": 0.9})
        ... class LookoutConfig(ScanningSensorConfig):
        ...     pass
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_sensor_models(self):
        ...         yield scanning_model("LOOKOUT", "a lookout", LookoutConfig)
        >>> Host.of(Plugin()).component(SensorModel, "LOOKOUT").summary
        'a lookout: staring, 5 s; SWIR 2.5-3 um'
        """

    @hookspec
    def opir_detection_models(self) -> Iterable[c.DetectionModel]:  # type: ignore[empty-body]
        """Yield detection models: exposures to probability of detection. A scene chooses one with
        `detection: NAME`.

        >>> import numpy as np
        >>> from opir_core.plugin import DetectionModel, DetectionProbability, Host, Measured, hookimpl
        >>> class Sure(DetectionProbability):
        ...     def probability(self, exposures):
        ...         return np.ones(len(exposures))
        ...     def measure(self, exposures, rng):
        ...         return Measured(bands=np.ones(len(exposures), dtype=np.uint8), snr=np.full(len(exposures), np.nan))
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_detection_models(self):
        ...         yield DetectionModel(name="sure", summary="P_d = 1", build=lambda config, context: Sure())
        >>> Host.of(Plugin()).component(DetectionModel, "sure").build(None, None).probability(range(2))
        array([1., 1.])
        """

    @hookspec
    def opir_confidence_models(self) -> Iterable[c.ConfidenceModel]:  # type: ignore[empty-body]
        """Yield confidence models: detections and their history to confidence. Chosen with
        `confidence: NAME`.

        >>> import numpy as np
        >>> from opir_core.plugin import Confidence, ConfidenceModel, Host, hookimpl
        >>> class Even(Confidence):
        ...     def confidence(self, sightings):
        ...         return np.full(len(sightings), 0.5)
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_confidence_models(self):
        ...         yield ConfidenceModel(name="even", summary="always 0.5", build=lambda config, context: Even())
        >>> Host.of(Plugin()).component(ConfidenceModel, "even").build(None, None).confidence(range(2))
        array([0.5, 0.5])
        """

    @hookspec
    def opir_classifiers(self) -> Iterable[c.ClassifierModel]:  # type: ignore[empty-body]
        """Yield classifiers: measurements to the reported target type. Chosen with `classification:
        NAME`.

        >>> import numpy as np
        >>> from opir_core.plugin import REPORTED_TYPES, Classifier, ClassifierModel, Host, hookimpl
        >>> class Cautious(Classifier):
        ...     def reported_type(self, sightings, rng):
        ...         return np.full(len(sightings), REPORTED_TYPES.index("UNKNOWN"), dtype=np.uint8)
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_classifiers(self):
        ...         yield ClassifierModel(name="cautious", summary="UNKNOWN", build=lambda config, context: Cautious())
        >>> Host.of(Plugin()).component(ClassifierModel, "cautious").summary
        'UNKNOWN'
        """

    @hookspec
    def opir_trackers(self) -> Iterable[c.TrackerModel]:  # type: ignore[empty-body]
        """Yield trackers: detections to tracks. Chosen with `tracker: NAME`.

        A tracker sees detections only, never truth.

        >>> import numpy as np
        >>> from opir_core.plugin import Host, Tracker, TrackerModel, Tracks, hookimpl
        >>> class Blind(Tracker):
        ...     cadence_s = None
        ...     def associate(self, detections):
        ...         return np.full(len(detections), -1)
        ...     def step(self, tick_s, detections):
        ...         return Tracks.empty()
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_trackers(self):
        ...         yield TrackerModel(name="blind", summary="no tracks", build=lambda config, context: Blind())
        >>> len(Host.of(Plugin()).component(TrackerModel, "blind").build(None, None).step(2.0, []))
        0
        """

    @hookspec
    def opir_tracker_parts(self) -> Iterable[c.TrackerPart]:  # type: ignore[empty-body]
        """Yield parts of trackers: association, motion, initiation, pruning, forecast.

        Chosen by the key of its `role` in a tracker's block, `tracker: {model: imm, association:
        NAME}`.

        >>> from opir_core.plugin import Host, TrackerPart, hookimpl
        >>> def nearest(config, context):
        ...     from my_package.nearest import Nearest  # an opir_trackers.Associator
        ...     return Nearest()
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_tracker_parts(self):
        ...         yield TrackerPart(name="nearest", summary="nearest line", role="association", build=nearest)
        >>> Host.of(Plugin()).component(TrackerPart, "nearest").role
        'association'
        """

    @hookspec
    def opir_directors(self) -> Iterable[c.DirectorModel]:  # type: ignore[empty-body]
        """Yield directors: what has arrived, to commands for sensors with a narrow field. Chosen
        with `director: NAME`.

        >>> from opir_core.plugin import Command, Director, DirectorModel, Host, hookimpl
        >>> class Poleward(Director):
        ...     interval_s = 60.0
        ...     def commands(self, situation):
        ...         pole_m = [0.0, 0.0, 6.4e6]
        ...         return [Command(sensor=sensor.id, position_ecef_m=pole_m) for sensor in situation.sensors]
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_directors(self):
        ...         yield DirectorModel(name="poleward", summary="poleward", build=lambda config, context: Poleward())
        >>> Host.of(Plugin()).component(DirectorModel, "poleward").build(None, None).interval_s
        60.0
        """

    @hookspec
    def opir_target_models(self) -> Iterable[c.TargetModel]:  # type: ignore[empty-body]
        """Yield target models: launches to trajectories and plumes. Chosen with `model: NAME` in a
        target's block.

        >>> from attrs import frozen
        >>> from opir_core.plugin import Host, TargetModel, hookimpl, number
        >>> @frozen
        ... class HoverConfig:
        ...     height_km: float = number(default=10.0, minimum=0.0, unit="km", source="notional", help="height")
        >>> def hovering(configs, context):
        ...     from my_package.hovering import Hovering  # a Trajectories, imported only for scenes that name it
        ...     return Hovering(configs, context)
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_target_models(self):
        ...         yield TargetModel(name="hover", summary="stands still", config=HoverConfig, build=hovering)
        >>> Host.of(Plugin()).component(TargetModel, "hover").config()
        HoverConfig(height_km=10.0)
        """

    @hookspec
    def opir_target_classes(self) -> Iterable[TargetClass]:  # type: ignore[empty-body]
        """Yield target classes: boost profiles, what follows burnout, plumes. Chosen with `type:
        NAME` in a target.

        >>> from opir_core.plugin import BoostProfile, Host, Plume, TargetClass, hookimpl
        >>> SOUNDING = BoostProfile("sounding", 40.0, 5.0, 1.0, 1.0, 2000.0, 1.2, reference_range_m=3e5)
        >>> PLUMES = {"sounding": Plume(peak_w_sr={"SWIR": 1e5, "MWIR": 5e4, "LWIR": 1e4})}
        >>> ROCKET = {"name": "ROCKET", "reported_type": "SRBM", "profiles": (SOUNDING,), "plumes": PLUMES}
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_target_classes(self):
        ...         yield TargetClass(summary="a sounding rocket, notional", **ROCKET)
        >>> Host.of(Plugin()).component(TargetClass, "ROCKET").profile(range_m=2e5).name
        'sounding'
        """

    @hookspec
    def opir_signature_models(self) -> Iterable[c.SignatureModel]:  # type: ignore[empty-body]
        """Yield signature models: how brightly targets radiate. Chosen with `signature: NAME` in a
        target's block.

        >>> import numpy as np
        >>> from opir_core.plugin import Host, SignatureModel, Signatures, hookimpl
        >>> class Torch(Signatures):
        ...     def intensity_w_sr(self, band, target, time_since_ignition_s, altitude_m, aspect_rad):
        ...         return np.full(len(target), 2e5)
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_signature_models(self):
        ...         yield SignatureModel(name="torch", summary="200 kW/sr", build=lambda configs, context: Torch())
        >>> Host.of(Plugin()).component(SignatureModel, "torch").summary
        '200 kW/sr'
        """

    @hookspec
    def opir_source_models(self) -> Iterable[c.SourceModel]:  # type: ignore[empty-body]
        """Yield source models: emitters other than targets. Chosen with `model: NAME` in a block
        of `sources`.

        >>> from opir_core.plugin import Host, SourceModel, Sources, hookimpl
        >>> class NoFires(Sources):
        ...     ids = ()
        ...     trajectories = signatures = None
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_source_models(self):
        ...         yield SourceModel(name="quiet", summary="no fires", build=lambda config, context: NoFires())
        >>> Host.of(Plugin()).component(SourceModel, "quiet").build(None, None).ids
        ()
        """

    @hookspec
    def opir_atmosphere_models(self) -> Iterable[c.AtmosphereModel]:  # type: ignore[empty-body]
        """Yield atmosphere models: a path to in-band transmittance. Chosen with `atmosphere: NAME`.

        >>> import numpy as np
        >>> from opir_core.plugin import AtmosphereModel, Host, Transmittance, hookimpl
        >>> class Haze(Transmittance):
        ...     def transmittance(self, band, path):
        ...         return np.where(path.height_m < 1e5, 0.8, 1.0)
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_atmosphere_models(self):
        ...         yield AtmosphereModel(name="haze", summary="80 % pass", build=lambda config, context: Haze())
        >>> Host.of(Plugin()).component(AtmosphereModel, "haze").build(None, None).cloud_top_m(np.zeros((1, 3)))
        array([-inf])
        """

    @hookspec
    def opir_background_models(self) -> Iterable[c.BackgroundModel]:  # type: ignore[empty-body]
        """Yield background models: background radiance and clutter. Chosen with `background: NAME`.

        >>> import numpy as np
        >>> from opir_core.plugin import Background, BackgroundModel, Host, hookimpl
        >>> class Grey(Background):
        ...     def radiance_w_m2_sr(self, band, view):
        ...         return np.full(len(view), 0.1)
        ...     clutter_w_m2_sr = radiance_w_m2_sr
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_background_models(self):
        ...         yield BackgroundModel(name="grey", summary="0.1 W/m2/sr", build=lambda config, context: Grey())
        >>> Host.of(Plugin()).component(BackgroundModel, "grey").build(None, None).clutter_w_m2_sr(0, range(1))
        array([0.1])
        """

    @hookspec
    def opir_event_encoders(self) -> Iterable[c.EventEncoder]:  # type: ignore[empty-body]
        """Yield event encoders: detections to message bytes. Chosen with `encoder: NAME` in an
        output's block.

        >>> from opir_core.plugin import Encoder, EventEncoder, Host, hookimpl
        >>> class Times(Encoder):
        ...     content_type, schema_version = "application/json", "times-1"
        ...     def encode(self, window):
        ...         return b"".join(b"%.1f\\n" % time_s for time_s in window.detections.time_s)
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_event_encoders(self):
        ...         yield EventEncoder(name="times", summary="times alone", build=lambda config, context: Times())
        >>> Host.of(Plugin()).component(EventEncoder, "times").build(None, None).schema_version
        'times-1'
        """

    @hookspec
    def opir_sinks(self) -> Iterable[c.SinkModel]:  # type: ignore[empty-body]
        """Yield sinks: where events go. Chosen with `- NAME: {...}` under `outputs`.

        >>> from opir_core.plugin import Delivery, Host, Sink, SinkModel, hookimpl
        >>> class Census(Sink):
        ...     written = 0
        ...     def write(self, window):
        ...         self.written += len(window.detections)
        ...     def close(self):
        ...         return Delivery(delivered=self.written)
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_sinks(self):
        ...         yield SinkModel(name="census", summary="counts", build=lambda config, context: Census())
        >>> Host.of(Plugin()).component(SinkModel, "census").build(None, None).close().delivered
        0
        """

    @hookspec
    def opir_renderers(self) -> Iterable[c.RendererModel]:  # type: ignore[empty-body]
        """Yield renderers: columns to the lines of events and truth. All make the same bytes.

        The environment variable `OPIR_RENDERER` names one; by default it is `compiled` if that is
        installed and works, else `reference`. `render(count, columns)` returns `count` lines. A
        column is text common to all lines (`bytes`), or has `plain()`, which returns a tuple of its
        kind and its values:

        * `("looked", texts, row)`: the text of each line by its row (n,); row None: `texts` (n,)
          are those of the lines
        * `("decimal", values, decimals)`: numbers (n,), rounded, as the shortest text of the
          double; nan, inf: `null`
        * `("ids", words)`: UUIDs from two 64-bit words (n, 2), the most significant first
        * `("times", unix_us)`: UTC (n,), µs since 1970-01-01, as `2026-04-01T12:00:00.050000Z`

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
    def opir_readers(self) -> Iterable[c.FileReader]:  # type: ignore[empty-body]
        """Yield readers: files of other programs to flights or orbits. A file is read by whoever
        recognises it.

        A scene may name one with `format: NAME` in the block of a target of the model `table`;
        `opir import FILE` shows what a reader makes of a file.

        >>> import numpy as np
        >>> from opir_core.plugin import FileReader, Host, StateTable, hookimpl
        >>> def two_states(config, context):
        ...     rows = np.array([line.split() for line in context.text.splitlines()[1:]], dtype=float)
        ...     return StateTable(rows[:, 0], rows[:, 1:], None, np.zeros(len(rows), int), rows[[[0, -1]], 0])
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_readers(self):
        ...         yield FileReader(
        ...             name="pad",
        ...             summary="lines of time and place below the word PAD",
        ...             recognises=lambda text: text.startswith("PAD"),
        ...             example="PAD\\n0 6.4e6 0 0\\n9 6.5e6 0 0\\n",
        ...             build=two_states,
        ...         )
        >>> Host.of(Plugin()).component(FileReader, "pad").yields
        'trajectories'
        """

    @hookspec
    def opir_metrics(self) -> Iterable[c.MetricModel]:  # type: ignore[empty-body]
        """Yield metrics: figures of finished runs. A study chooses them by name under `metrics`.

        >>> from opir_core.plugin import Host, Metric, MetricModel, hookimpl
        >>> class Seen(Metric):
        ...     units = {"seen": ""}
        ...     def values(self, run):
        ...         return {"seen": sum(target["detections"] > 0 for target in run.summary["targets"])}
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_metrics(self):
        ...         yield MetricModel(name="seen", summary="targets detected", build=lambda config, context: Seen())
        >>> Host.of(Plugin()).component(MetricModel, "seen").build(None, None).units
        {'seen': ''}
        """

    @hookspec
    def opir_executors(self) -> Iterable[c.ExecutorModel]:  # type: ignore[empty-body]
        """Yield executors: where the runs of a study are made. A study chooses one with `executor:
        NAME`.

        >>> from opir_core.plugin import Executor, ExecutorModel, Host, hookimpl
        >>> class Patient(Executor):
        ...     def results(self, function, tasks):
        ...         yield from enumerate(map(function, tasks))
        ...     def close(self):
        ...         pass
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_executors(self):
        ...         yield ExecutorModel(name="patient", summary="in order", build=lambda config, context: Patient())
        >>> list(Host.of(Plugin()).component(ExecutorModel, "patient").build(None, None).results(abs, [-2]))
        [(0, 2)]
        """

    @hookspec
    def opir_exporters(self) -> Iterable[c.ExporterModel]:  # type: ignore[empty-body]
        """Yield exporters: formats of other programs. `opir export RUN --to NAME` chooses one.

        >>> from opir_core.plugin import Exporter, ExporterModel, Host, hookimpl
        >>> class Notes(Exporter):
        ...     suffix = ".txt"
        ...     def write(self, run, path):
        ...         path.write_text(f"{len(run.detections)} detections")
        ...         return [path]
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_exporters(self):
        ...         yield ExporterModel(name="notes", summary="a note", build=lambda config, context: Notes())
        >>> Host.of(Plugin()).component(ExporterModel, "notes").build(None, None).suffix
        '.txt'
        """

    @hookspec
    def opir_run_views(self) -> Iterable[c.RunView]:  # type: ignore[empty-body]
        """Yield run views: a finished run in another form, tables or plots for instance.
        `run.view(NAME)` returns one.

        `build(run)` gets an `opir_core.Run` and changes nothing of it. `run.plot`, `run.tables()`,
        `run.to_pandas()` and `run.to_polars()` return the views `plot`, `tables`, `pandas` and
        `polars`; `run.save(PATH)`, `run.report(PATH)` and `run.score()` call the functions that
        `save`, `report` and `score` are; a notebook shows the view `map`, an element of HTML or SVG
        as text. An allow-list of the host that the run was made with also applies to views.

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

        `commands` is argparse's object of subparsers. Called when the command line is asked for a
        command that the core does not have, or for its help; not when a core command runs. A parser
        added must set `run` as a default: `parser.set_defaults(run=function, group="look")`, where
        `function(arguments) -> int` returns the exit code, and `group` is the group of the command
        in `opir --help`: run, study, look, data or maintain.

        >>> import argparse
        >>> from opir_core.plugin import hookimpl
        >>> class Plugin:
        ...     @hookimpl
        ...     def opir_add_commands(self, commands):
        ...         parser = commands.add_parser("hello", help="return the number of its letters")
        ...         parser.set_defaults(run=lambda arguments: len("hello"), group="look")
        >>> parser = argparse.ArgumentParser()
        >>> Plugin().opir_add_commands(parser.add_subparsers())
        >>> arguments = parser.parse_args(["hello"])
        >>> arguments.run(arguments)
        5
        """
