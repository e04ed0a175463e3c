"""The target model `table`: trajectories that a scene brings itself, as tables of states in
files.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import define, evolve, frozen

from opir_core.arrays import ByteArray, FloatArray, IndexArray
from opir_core.errors import Problem, SceneError
from opir_core.flight import Ephemeris, joined_burns_s, plain_gaps_s
from opir_core.geometry import ecef_to_geodetic
from opir_core.plugin import BadFileError, StateTable, TargetContext, Trajectories
from opir_readers.columns import UNREAD
from opir_readers.configs import AscentConfig, TableConfig
from opir_readers.flights.refining import refined
from opir_readers.formats import READERS
from opir_readers.interpolation import Interpolant, interpolant, largest_doubt_m
from opir_readers.reading import content_of, file_text, reader_of
from opir_readers.table_checks import SceneTimes, findings_of

#: How far the polynomials may be from those through the states, m.
EPHEMERIS_TOLERANCE_M = 0.01


@define(eq=False)
class TableTargets(Trajectories):
    """Targets on the trajectories of their files: to burnout, or to the last state where a sensor
    follows them.
    """

    type_code: ByteArray
    ignition_s: FloatArray
    burnout_s: FloatArray
    end_s: FloatArray
    burns_s: FloatArray
    flight: Ephemeris
    records: tuple[Mapping[str, Any], ...]
    warnings: Sequence[Problem] = ()

    @property
    def class_names(self) -> Sequence[str]:
        """Names of the target classes."""
        return [record["type"] for record in self.records]

    def position_ecef_m(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (m, 3) of targets (m,) at scene times (m,); nan outside ignition to
        `end_s`.
        """
        return self.flight.position_m(target, time_s)

    @property
    def files(self) -> Sequence[Mapping[str, str]]:
        """Return the files that were read, with their SHA-256, for the manifest: a scene's hash
        does not know them.
        """
        return [{"path": record["file"], "sha256": record["sha256"]} for record in self.records]

    def truth(self) -> Sequence[Mapping[str, Any]]:
        """Return one mapping a target: its file with its hash, burn, gaps, and the error of the
        interpolation.

        Launch and impact are there where the first state is the ignition, and the last one after
        burnout, near the ground.
        """
        return self.records


@frozen(eq=False)
class TableFlights:
    """Flights through the states of tables: their curve, and scene times (n,) of ignition, burnout
    and end, s.
    """

    tables: Sequence[StateTable]
    curve: Interpolant
    ignition_s: FloatArray
    burnout_s: FloatArray
    end_s: FloatArray

    def ephemeris(self, start_s: FloatArray, end_s: FloatArray) -> Ephemeris:
        """Return the ephemeris of a span of each flight (n,).

        At the times of the states one polynomial gives way to the next.
        """
        longest = max(len(table.time_s) for table in self.tables)
        breakpoints_s = [
            np.pad(table.time_s, (0, longest - len(table.time_s)), mode="edge")
            for table in self.tables
        ]
        return Ephemeris.build(
            self.curve.state, start_s, end_s, np.stack(breakpoints_s), EPHEMERIS_TOLERANCE_M
        )

    def columns(
        self, configs: Sequence[TableConfig | AscentConfig], context: TargetContext
    ) -> dict[str, Any]:
        """Return the columns of targets, by the names of their fields."""
        codes = [context.target_class(config.type).type_code for config in configs]
        return {
            "type_code": np.array(codes, dtype=np.uint8),
            "ignition_s": self.ignition_s,
            "burnout_s": self.burnout_s,
            "end_s": self.end_s,
            "burns_s": joined_burns_s([table.burns_s[None] for table in self.tables]),
        }


def flights_of(tables: Sequence[StateTable], context: TargetContext) -> TableFlights:
    """Return the flights of tables: to burnout, or to the last state where a sensor follows
    them.
    """
    ignition_s = np.array([table.burns_s[0, 0] for table in tables])
    burnout_s = np.array([table.burns_s[-1, 1] for table in tables])
    end_s = np.array([table.time_s[-1] for table in tables]) if context.free_flight else burnout_s
    return TableFlights(tables, interpolant(tables), ignition_s, burnout_s, end_s)


def table_targets(configs: Sequence[TableConfig], context: TargetContext) -> Trajectories:
    """Return the trajectories of all targets of the model.

    Raises `SceneError` with a problem for each target whose file cannot be taken.
    """
    problems = []
    warnings = []
    tables = []
    hashes = []
    times = SceneTimes(context.epoch_us, context.duration_s)
    for config, path in zip(configs, context.paths, strict=True):
        place = f"{path}.file"
        try:
            table, digest = _table(config, context)
            start_s = None if table.has_dates else config.start_s or 0.0
            findings = findings_of(table, times, start_s, as_given=config.as_given)
            unread = [words for words in findings.notes if words.startswith(UNREAD)]
            doubts = [*unread, *findings.warnings]
            warnings += [Problem(place, f"{config.file}: {words}") for words in doubts]
            problems += [Problem(place, f"{config.file}: {words}") for words in findings.refused]
            if not findings.refused:
                tables.append(_with_burn(table, config))
                hashes.append(digest)
        except BadFileError as error:
            problems.append(Problem(place, f"{config.file}: {error.args[0]}".removeprefix(": ")))
    if problems:
        raise SceneError(problems)
    flights = flights_of(tables, context)
    return TableTargets(
        **flights.columns(configs, context),
        flight=flights.ephemeris(flights.ignition_s, flights.end_s),
        records=tuple(map(_record, context.ids, configs, tables, hashes)),
        warnings=tuple(warnings),
    )


def _table(config: TableConfig, context: TargetContext) -> tuple[StateTable, str]:
    """Return the table of a file, and the SHA-256 of the file."""
    file = file_text(config.file)
    readers = [reader for reader in context.readers() or READERS if reader.yields == "trajectories"]
    reader = reader_of(file.text, readers, config.format, config.columns)
    names = ("columns", "start_s", "object", "site")
    settings = {name: getattr(config, name) for name in names}
    table = content_of(file.text, reader, settings, context.epoch_us)
    return refined(table, config.noise_m, config.burns), file.sha256


def _with_burn(table: StateTable, config: TableConfig) -> StateTable:
    """Return a table with the first ignition and the last burnout that its block asks for.

    Raises `BadFileError` where the states do not cover them.
    """
    ignition, *_, burnout = table.burns_s.ravel().tolist()
    ignition = ignition if config.ignition_s is None else config.ignition_s
    burnout = burnout if config.burnout_s is None else config.burnout_s
    begin, end = table.time_s[[0, -1]].tolist()
    burn = f"a burn from {ignition:.12g} to {burnout:.12g} s"
    if not max(begin, 0.0) <= ignition < burnout <= end:
        raise BadFileError(
            f"{burn} does not fit: states go from {begin:.12g} to {end:.12g} s of the scene, whose"
            " times start at 0; set ignition_s and burnout_s"
        )
    burns_s = table.burns_s[(table.burns_s[:, 0] < burnout) & (table.burns_s[:, 1] > ignition)]
    if not len(burns_s):
        raise BadFileError(f"{burn} is within a dark gap of the file")
    burns_s[0, 0] = ignition
    burns_s[-1, 1] = burnout
    return evolve(table, burns_s=burns_s)


def place_of(position_m: FloatArray) -> dict[str, float]:
    """Return a position (3,) as a plain geodetic place, with its height above the WGS 84
    ellipsoid.
    """
    where = ecef_to_geodetic(position_m[None])
    return {
        "lat_deg": float(np.degrees(where.latitude_rad[0])),
        "lon_deg": float(np.degrees(where.longitude_rad[0])),
        "height_m": float(where.height_m[0]),
    }


def _points(table: StateTable) -> Mapping[str, Any]:
    """Return launch and impact of a table: its first and last states, where these are below 1000 m."""
    launch = place_of(table.position_m[0])
    impact = place_of(table.position_m[-1])
    points = {}
    if launch["height_m"] < 1000.0 and table.burns_s[0, 0] == table.time_s[0]:
        points["launch"] = launch
    if impact["height_m"] < 1000.0 and table.burns_s[-1, 1] < table.time_s[-1]:
        points["impact"] = {**impact, "time_s": float(table.time_s[-1])}
    return points


def _record(
    target_id: str, config: TableConfig, table: StateTable, digest: str
) -> Mapping[str, Any]:
    return {
        "id": target_id,
        "type": config.type,
        "file": config.file,
        "sha256": digest,
        "states": len(table.time_s),
        "ignition_s": float(table.burns_s[0, 0]),
        "burnout_s": float(table.burns_s[-1, 1]),
        "gaps_s": plain_gaps_s(table.burns_s),
        **_points(table),
        "interpolation_error_m": largest_doubt_m(table),
        "tolerance_m": EPHEMERIS_TOLERANCE_M,
    }
