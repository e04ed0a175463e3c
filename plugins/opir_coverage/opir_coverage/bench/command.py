"""What `opir physics` does: evaluate a formula, or put a sensor on the bench."""

import argparse
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from opir_core import compile_plan, load_scene, scene_from_mapping
from opir_core.errors import ModelError
from opir_core.output import OutputFiles
from opir_coverage.bench.bands import LOWTRAN_EDGES_UM, BandLimits, best_bands
from opir_coverage.bench.budget import NoiseBudget, noise_budget, waterfall
from opir_coverage.bench.causes import false_alarms, window
from opir_coverage.bench.curves import curve, operating_characteristic
from opir_coverage.bench.frames import frame, write_frame
from opir_coverage.bench.movie_files import write_movies
from opir_coverage.bench.movies import Clip, Filming, clip
from opir_coverage.bench.results import BenchLine, BenchPlot, BenchResult, write_plot
from opir_coverage.bench.stand import Bench, Poses
from opir_coverage.looks import band_thresholds


def physics(arguments: argparse.Namespace) -> int:
    """Print a result of the bench as a table or JSON, and draw it into a file."""
    result = _RESULTS[arguments.quantity](arguments)
    sys.stdout.write(
        (json.dumps(result.plain(), indent=2) if arguments.json else result.text()) + "\n"
    )
    if arguments.plot:
        path = Path(arguments.plot)
        if path.suffix not in (".png", ".svg", ".pdf"):
            raise ModelError(f"--plot: {path.name!r} ends in none of .png, .svg, .pdf")
        with OutputFiles() as files, files.writing(path, "plot") as part:
            write_plot(result, part, path.suffix[1:])
        sys.stdout.write(f"{path}: plot\n")
    return 0


def benches_of(arguments: argparse.Namespace) -> list[Bench]:
    """Return the sensors on the bench: those of the scene, or models alone."""
    if arguments.scene:
        scene = load_scene(arguments.scene, overrides=arguments.overrides)
        names: Sequence[str | None] = arguments.sensor or [None]
        return [Bench.of_scene(scene, name) for name in names]
    if not arguments.sensor:
        raise ModelError(
            "give a scene, or a sensor model with --sensor: opir physics budget --sensor SBIRS-GEO"
        )
    alone = [Bench.of_model(name) for name in arguments.sensor]
    if not arguments.overrides:
        return alone
    return [
        Bench.of_scene(scene_from_mapping(each.mapping, overrides=arguments.overrides))
        for each in alone
    ]


def _pose(arguments: argparse.Namespace) -> dict[str, float]:
    return {
        "height_m": 1e3 * arguments.height,
        "elevation_rad": math.radians(arguments.elevation),
        "aspect_rad": math.radians(arguments.aspect),
        "burned": arguments.burned,
        "speed_m_s": arguments.speed,
    }


def _poses(arguments: argparse.Namespace) -> Poses:
    return Poses.of(arguments.classes[0], **_pose(arguments))


def budget_of(arguments: argparse.Namespace) -> BenchResult:
    """Return the budget of noise by term, or the steps of one band's SNR."""
    bench = benches_of(arguments)[0]
    found = noise_budget(bench, _poses(arguments))
    return _waterfall(bench, found, arguments.band) if arguments.waterfall else _terms(bench, found)


def _terms(bench: Bench, found: NoiseBudget) -> BenchResult:
    rows: list[list[Any]] = [[each.name, *each.sigma_w_m2] for each in found.terms]
    rows += [
        ["all noise", *found.whole_w_m2],
        ["NEI before a dark background", *found.nei_w_m2],
        ["NEDT at 300 K, K", *found.nedt_k],
        ["irradiance of the target", *found.light_w_m2],
        ["left by frame difference and wells", *found.signals.irradiance_w_m2[0]],
        ["SNR of one look", *found.signals.snr[0]],
    ]
    names = [each.name for each in found.terms]
    lines = [
        BenchLine(
            band, np.zeros(len(names)), np.array([each.sigma_w_m2[place] for each in found.terms])
        )
        for place, band in enumerate(found.bands)
    ]
    plot = BenchPlot(
        x_label="",
        y_label="standard deviation at the aperture, W/m²",
        lines=lines,
        names=names,
        log_y=True,
    )
    notes = [f"P_d of one look: {found.signals.chance[0]:.4g}"]
    return BenchResult(
        title=f"Noise of one look of {bench.sensor.id}, W/m2",
        head=("term", *found.bands),
        rows=rows,
        plot=plot,
        notes=notes,
    )


def _waterfall(bench: Bench, found: NoiseBudget, name: str) -> BenchResult:
    radiometer = bench.sensor.radiometer
    assert radiometer is not None
    band = _band_of(bench, name) if name else radiometer.reference
    steps = waterfall(found, band, float(band_thresholds(bench.sensor)[band]))
    rows = [[each.name, each.gain_db, each.level_db, each.value] for each in steps]
    line = BenchLine(
        found.bands[band],
        np.array([each.level_db - each.gain_db for each in steps]),
        np.array([each.gain_db for each in steps]),
    )
    plot = BenchPlot(
        x_label="", y_label="level, dB", lines=[line], names=[each.name for each in steps]
    )
    title = f"From source to decision, {bench.sensor.id}, {found.bands[band]}"
    notes = [
        (
            f"margin over the threshold: {steps[-1].level_db:.2f} dB; P_d of one look:"
            f" {found.signals.chance[0]:.4g}"
        )
    ]
    return BenchResult(
        title=title,
        head=("step", "gain dB", "level dB", "value"),
        rows=rows,
        plot=plot,
        notes=notes,
    )


def _curve(arguments: argparse.Namespace) -> BenchResult:
    benches = benches_of(arguments)
    return curve(
        benches,
        arguments.of,
        arguments.against,
        arguments.classes,
        _pose(arguments),
        arguments.values,
    )


def _roc(arguments: argparse.Namespace) -> BenchResult:
    return operating_characteristic(benches_of(arguments)[0], _poses(arguments))


def _false_alarms(arguments: argparse.Namespace) -> BenchResult:
    if not arguments.scene:
        return false_alarms(benches_of(arguments)[0].plan)
    return false_alarms(compile_plan(load_scene(arguments.scene, overrides=arguments.overrides)))


def _window(arguments: argparse.Namespace) -> BenchResult:
    return window(benches_of(arguments)[0], math.radians(arguments.elevation))


def _bands(arguments: argparse.Namespace) -> BenchResult:
    heights_m = 1e3 * np.array(arguments.heights or (arguments.height,))
    poses = [
        Poses.of(name, **{**_pose(arguments), "height_m": heights_m}) for name in arguments.classes
    ]
    limits = BandLimits(
        arguments.edges or LOWTRAN_EDGES_UM, arguments.least_width, arguments.most_width
    )
    return best_bands(benches_of(arguments)[0], poses, limits, arguments.most)


def frame_command(arguments: argparse.Namespace) -> int:
    """Write one simulated frame of a focal plane as a picture and as an array, or movies of
    frames.
    """
    bench = benches_of(arguments)[0]
    poses = _poses(arguments)
    band = _band_of(bench, arguments.band)
    folder = Path(arguments.out)
    if arguments.movie:
        every_s = bench.sensor.scan.period_ns * 1e-9 if arguments.every is None else arguments.every
        if arguments.clips < 1:
            raise ModelError("--clips: give at least 1")
        filming = Filming(
            frames=arguments.movie,
            every_s=every_s,
            pixels=arguments.pixels,
            band=band,
            snr=arguments.snr,
        )
        made = [
            clip(bench, poses, filming, arguments.seed + number)
            for number in range(arguments.clips)
        ]
        written = write_movies(made, folder)
        sys.stdout.write("".join(f"{_in_short(each)}\n" for each in made))
    else:
        written = write_frame(frame(bench, poses, arguments.pixels, arguments.seed, band), folder)
    for path in written:
        sys.stdout.write(f"{path}\n")
    return 0


def _band_of(bench: Bench, name: str) -> int:
    """Return the number of a band by its name, the first for none."""
    names = [band.name for band in bench.sensor.bands]
    if name and name not in names:
        raise ModelError(f"--band: {name!r} is not one of {', '.join(names)}")
    return names.index(name) if name else 0


def _in_short(made: Clip) -> str:
    seen = made.snr[made.snr > 0.0]
    words = (
        f"SNR of its brightest pixel {seen.min():.3g} to {seen.max():.3g}"
        if len(seen)
        else "beside all frames"
    )
    of = f"{made.sensor} {made.band}, seed {made.seed}: {made.target_class}"
    return f"{of} in {len(seen)} of {len(made)} frames; {words}"


_RESULTS = {
    "budget": budget_of,
    "curve": _curve,
    "roc": _roc,
    "false-alarms": _false_alarms,
    "window": _window,
    "bands": _bands,
}
