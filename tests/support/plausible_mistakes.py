"""Mistakes that an author of a plugin makes, each in the template of its kind, and a package of each."""

import tomllib
from pathlib import Path

from attrs import frozen
from opir_testing.commands.new_plugin import plugin_files

from opir_core.plugin import Host

#: The name of each package; a mistake adds its number.
STEM = "mistake"


@frozen
class Mistake:
    """What is written in place of what, in the code or the metadata, and words of what is reported.

    `words` is "" for a mistake that no test of a component can find; `missed` says why.
    """

    kind: str
    edits: tuple[tuple[str, str], ...]
    words: str
    missed: str = ""


def mistake(kind: str, right: str, wrong: str, words: str, *more: tuple[str, str]) -> Mistake:
    """Return a mistake of one edit, or of more."""
    return Mistake(kind, ((right, wrong), *more), words)


def imports(module: str) -> tuple[str, str]:
    """Return the edit that imports a module."""
    return "from collections.abc import", f"import {module}\nfrom collections.abc import"


BURN = "return self.launch_ecef_m[target] + 0.5 * (since_s * since_s)[:, None] * self.acceleration_ecef_m_s2[target]"
CHANCE = "return self.peak * np.exp(-relative * relative)"
CONFIDENCE = (
    "return np.clip(fraction * -np.expm1(-sightings.detection_count / self.enough), 0.0, 1.0)"
)
TYPES = "return np.where(sightings.detection_count >="
NEW_TRACKER = "def __init__(self, cadence_s: float, gate_rad: float) -> None:"
CSV = 'path.write_text("\\n".join(lines) + "\\n", encoding="utf-8")'
DARK = "np.where(view.height_m > 0.0, 0.0, self.radiance)"

MISTAKES = {
    # Units, angles and frames.
    "target in degrees": mistake(
        "target", "np.radians([(point", "np.array([(point", "from its launch point"
    ),
    "target in kilometres": mistake(
        "target", "return ground, unit", "return ground / 1e3, unit", "m of the Earth's centre"
    ),
    "target in an inertial frame": mistake(
        "target",
        BURN,
        f"x, y, z = ({BURN.removeprefix('return ')}).T\n"
        "        turn = 3.3 + 7.292115e-5 * time_s\n"
        "        return np.stack([x * np.cos(turn) - y * np.sin(turn),"
        " x * np.sin(turn) + y * np.cos(turn), z], axis=1)",
        "from its launch point",
    ),
    "source in degrees": mistake(
        "source",
        "np.radians([config.lat_deg]), np.radians([config.lon_deg])",
        "np.array([config.lat_deg]), np.array([config.lon_deg])",
        "from its place",
    ),
    "director in kilometres": mistake(
        "director", "=position_m[row],", "=position_m[row] / 1e3,", "km from the Earth's centre"
    ),
    "reader in kilometres": mistake(
        "reader",
        "1e3 * x_km, 1e3 * y_km, 1e3 * z_km",
        "x_km, y_km, z_km",
        "from the Earth's centre",
    ),
    "air by kilometres": mistake(
        "atmosphere", "path.height_m, 0.0)", "path.height_m, 0.0) / 1e3", "it is "
    ),
    "angle of a class in degrees": mistake(
        "target-class", "math.radians(30.0)", "30.0", "times, shape, burnout or ranges"
    ),
    "sigma in radians": mistake(
        "sensor", "sigma_urad=25.0", "sigma_urad=25e-6", "line_of_sight_sigma_urad"
    ),
    "period in seconds": mistake(
        "sensor", "scan_period_ms=500.0", "scan_period_ms=0.5", "scan_period_ms"
    ),
    "range in kilometres": Mistake(
        "detection",
        (("exposures.range_m / self", "exposures.range_m / 1e3 / self"),),
        "",
        "each value is a probability: which one is right only the author knows",
    ),
    "radians named degrees": Mistake(
        "encoder",
        (('"azimuth_deg": degrees(azimuth_rad)', '"azimuth_deg": azimuth_rad'),),
        "",
        "the names of an author's own format are not known",
    ),
    # Probabilities, shapes and values.
    "confidence in percent": mistake(
        "confidence", CONFIDENCE, "return 100.0 * fraction", "confidences are float64"
    ),
    "confidence of few digits": mistake(
        "confidence", CONFIDENCE, f"{CONFIDENCE}.astype(np.float32)", "confidences are float32"
    ),
    "types of many bytes": mistake(
        "classifier", ".astype(np.uint8)", ".astype(np.int64)", "codes are int"
    ),
    "shares that do not sum": mistake(
        "tracker", "types / types.sum(axis=1, keepdims=True)", "types", "type_probability"
    ),
    "intensity nan after burnout": mistake(
        "signature", "intensity, 0.0), 0.0)", "intensity, 0.0), np.nan)", "intensities are from nan"
    ),
    "intensity with an axis too many": mistake(
        "signature", "0.0), 0.0)", "0.0), 0.0)[:, None]", "intensity_w_sr"
    ),
    "shining space": mistake(
        "background", DARK, "np.full(len(view), self.radiance)", "space has 0.1"
    ),
    "share in percent": mistake(
        "metric", "len(spans) / count if", "100.0 * len(spans) / count if", "gives seen_for_s"
    ),
    "position after burnout": mistake(
        "target", "time_s <= self.burnout_s", "time_s < self.burnout_s", "outside its burn"
    ),
    "time of the last tick": mistake(
        "tracker",
        "np.full(count, tick_s)",
        "np.full(count, tick_s - 1.0)",
        "the rows are of tracks",
    ),
    # State, inputs and effects.
    "changed input": mistake(
        "detection",
        "relative = exposures.range_m / self.scale_m",
        "relative = exposures.range_m\n        relative /= self.scale_m",
        "read-only",
    ),
    "one buffer for all results": mistake(
        "detection",
        CHANCE,
        f"_BUFFER[: len(relative)] = {CHANCE.removeprefix('return ')}\n"
        "        return _BUFFER[: len(relative)]",
        "among all rows",
        ("\n\n\n@frozen(kw_only", "\n_BUFFER = np.zeros(1_000_000)\n\n\n@frozen(kw_only"),
    ),
    "global random numbers": mistake(
        "detection", CHANCE, f"{CHANCE} * np.random.uniform(0.9, 1.0)", "global random state"
    ),
    "random numbers of its own": mistake(
        "detection",
        CHANCE,
        f"{CHANCE} * np.random.default_rng(1).uniform(0.9, 1.0, len(relative))",
        "among all rows",
    ),
    "counts of earlier calls": mistake(
        "classifier",
        TYPES,
        "_CALLS.append(1)\n        return np.where(len(_CALLS) + sightings.detection_count >=",
        "in a second run",
        ("\nUNKNOWN =", "\n_CALLS: list[int] = []\nUNKNOWN ="),
    ),
    "one list for all trackers": mistake(
        "tracker",
        NEW_TRACKER,
        NEW_TRACKER.replace(")", ", state: list = [[], [], []])"),
        "in a second run",
        ("self._sensor: list[int] = []", "self._sensor, self._direction, self._type_count = state"),
        ("        self._direction: list[tuple[float, ...]] = []\n", ""),
        ("        self._type_count: list[list[int]] = []\n", ""),
    ),
    "learns while it associates": mistake(
        "tracker",
        "return self._nearest(detections.sensor",
        "self._gate_rad *= 0.5\n        return self._nearest(detections.sensor",
        "results depend on calls of associate",
    ),
    "counts that are truth": mistake(
        "tracker", "] += 1", "] += int(detections.detection_count[row])", "results change with"
    ),
    "environment": mistake(
        "detection",
        CHANCE,
        f'{CHANCE} * float(os.environ.get("OPIR_PEAK", "1"))',
        "the environment",
        imports("os"),
    ),
    "date in a file": mistake(
        "exporter",
        '["time_s,sensor',
        '[time.strftime("%Y"), "time_s,sensor',
        "the clock",
        imports("time"),
    ),
    "clock in a message": mistake(
        "encoder", '"time_s": time_s', '"sent": time.time()', "the clock", imports("time")
    ),
    "print in a tracker": mistake(
        "tracker",
        "return self._tracks(tick_s)",
        "print(tick_s)\n        return self._tracks(tick_s)",
        "it prints",
    ),
    "print in an exporter": mistake(
        "exporter", "return [path]", "print(path)\n        return [path]", "it prints"
    ),
    "warning of numpy": mistake(
        "confidence",
        CONFIDENCE,
        "return fraction / (1.0 + 1.0 / np.log(sightings.detection_count))",
        "it warns",
    ),
    "file left open by build": mistake(
        "background",
        "    return UniformBackground(config",
        '    open(__file__, encoding="utf-8").read()\n    return UniformBackground(config',
        "unclosed file",
    ),
    "file left open by write": mistake(
        "exporter",
        CSV,
        CSV.replace("write_text(", 'open("w").write(').replace(', encoding="utf-8"', ""),
        "unclosed file",
    ),
    "exit of Python": mistake(
        "tracker",
        "    return NearestTracker(",
        '    sys.exit("no licence")\n    return NearestTracker(',
        "SystemExit",
        imports("sys"),
    ),
    "loop over rows": mistake(
        "classifier",
        "np.minimum(self.type_code[sightings.target], UNKNOWN)",
        "np.array([min(int(code), UNKNOWN) for code in self.type_code[sightings.target]])",
        "steps of Python",
    ),
    "changed summary": mistake(
        "view",
        "    return {sensor",
        '    run.summary["seen"] = 1\n    return {sensor',
        "summary or manifest",
    ),
    # Outputs.
    "file beside the stage": mistake(
        "sink", "context.stage(config.path)", "Path(config.path)", "after a run that was given up"
    ),
    "file that is never closed": mistake("sink", "        self._file.close()\n", "", "bytes"),
    "file that is never flushed": mistake(
        "sink",
        "            self._file.flush()\n            os.fsync(self._file.fileno())\n",
        "            pass\n",
        "sync",
    ),
    "windows counted as events": mistake("sink", "+= len(found)", "+= 1", "are delivered"),
    "overwritten file": mistake(
        "sink", '"a") if context.resumes', '"w") if context.resumes', "shorter"
    ),
    "lost message": mistake(
        "encoder", 'f"{line}\\n" for line in lines', 'f"{line}\\n" for line in lines[1:]', "gives"
    ),
    "unlisted file": mistake("exporter", "return [path]", "return []", "write returns []"),
    "swallowed error": mistake(
        "executor",
        "yield running[done], done.result()",
        "if not done.exception():\n                yield running[done], done.result()",
        "is lost",
    ),
    # Commands, associations and fleets.
    "unknown sensor": mistake(
        "director", "sensor=sensor.id", 'sensor=f"{sensor.id}-1"', "it commands"
    ),
    "tracks without a state": mistake(
        "director",
        "        tracks = tracks.take(np.flatnonzero(np.isfinite(tracks.state).all(axis=1)))\n",
        "",
        "nan",
    ),
    "two satellites in a slot": mistake(
        "constellation", "-135.0, -105.0", "-135.0, -135.0", "positions at the epoch"
    ),
    "sensor model of another name": mistake(
        "constellation", '"generic-scanner"', '"generic-scaner"', "generic-scanner"
    ),
    # Settings and packages.
    "setting without effect": mistake(
        "confidence", "CountConfidence(config.enough)", "CountConfidence(10.0)", "enough"
    ),
    "setting of a reader without effect": mistake(
        "reader", "time_s + config.delay_s", "time_s", "delay_s"
    ),
    "setting without help": mistake(
        "confidence",
        ', help="number of detections with a confidence of 1 - 1/e"',
        "",
        "argument: 'help'",
    ),
    "settings that change": mistake(
        "confidence",
        "@frozen(kw_only=True)",
        "@define(kw_only=True)",
        "Config",
        ("import frozen", "import define, frozen"),
    ),
    "class inside of build": mistake(
        "confidence",
        "    return CountConfidence(config",
        "    class Local(CountConfidence):\n        pass\n\n    return Local(config",
        "cannot be pickled",
    ),
    "hook without a mark": mistake("confidence", "@hookimpl\n", "", "is not marked with @hookimpl"),
    "hook of another name": mistake(
        "confidence",
        "def opir_confidence_models",
        "def opir_confidence_model",
        "opir_confidence_models",
    ),
    "entry point to nothing": mistake(
        "confidence", '= "mistake', '= "nothing_mistake', "No module named"
    ),
    "name of another": mistake(
        "confidence", 'NAME = "mistake', 'NAME = "other-mistake', "does not offer it"
    ),
    "no range of versions": mistake("confidence", "opir-core>=0.1,<0.2", "opir-core", "opir-core"),
    "slow import": mistake("confidence", *imports("scipy.stats"), "scipy"),
    "wrong example": mistake(
        "confidence",
        'NAME = "mistake',
        '__doc__ += "\\n\\n>>> 1 + 1\\n3\\n"\nNAME = "mistake',
        "example",
    ),
}


def mistaken_package(number: int, found: Mistake, folder: Path, host: Host) -> str:
    """Write an installed package with a mistake below a folder, and return its name."""
    name = f"{STEM}-{number}"
    files = dict(plugin_files(found.kind, name, host))
    for right, wrong in found.edits:
        path = next(
            (path for path, text in files.items() if right in text and path.endswith(("y", "l"))),
            None,
        )
        assert path is not None, right
        files[path] = files[path].replace(right, wrong)
    module = name.replace("-", "_")
    (folder / f"{module}.py").write_text(files[f"{module}.py"], encoding="utf-8")
    project = tomllib.loads(files["pyproject.toml"])["project"]
    info = folder / f"{module}-{project['version']}.dist-info"
    info.mkdir()
    head = [f"Name: {name}", f"Version: {project['version']}"]
    head += [f"Requires-Dist: {requirement}" for requirement in project["dependencies"]]
    (info / "METADATA").write_text("\n".join(["Metadata-Version: 2.3", *head, ""]))
    lines = [
        line
        for group, points in project["entry-points"].items()
        for line in (f"[{group}]", *(f"{point} = {value}" for point, value in points.items()))
    ]
    (info / "entry_points.txt").write_text("\n".join([*lines, ""]))
    return name
