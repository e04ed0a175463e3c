"""The command `opir physics`: evaluate a formula, or put a sensor on the bench."""

import argparse
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from attrs import evolve
from opir_coverage import band_thresholds

from opir_bench.bands import LOWTRAN_EDGES_UM, BandLimits, best_bands
from opir_bench.budget import NoiseBudget, noise_budget, waterfall
from opir_bench.causes import false_alarms, window
from opir_bench.curves import curve, operating_characteristic
from opir_bench.frames import frame, write_frame
from opir_bench.movie_files import write_movies
from opir_bench.movies import Clip, Filming, clip
from opir_bench.results import BenchLine, BenchPlot, BenchResult, bars, write_plot
from opir_bench.stand import Bench, Poses
from opir_core import compile_plan, load_scene, scene_from_mapping
from opir_core.errors import ModelError
from opir_core.output import OutputFiles


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
        with OutputFiles() as files, files.writing(path, "plot") as file_part:
            write_plot(result, file_part, path.suffix[1:])
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
        Bench.of_scene(scene_from_mapping(bench.mapping, overrides=arguments.overrides))
        for bench in alone
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
    budget = noise_budget(bench, _poses(arguments))
    return (
        _waterfall(bench, budget, arguments.band) if arguments.waterfall else _terms(bench, budget)
    )


def _terms(bench: Bench, budget: NoiseBudget) -> BenchResult:
    rows: list[list[Any]] = [[term.name, *term.sigma_w_m2] for term in budget.terms]
    rows += [
        ["all noise", *budget.whole_w_m2],
        ["NEI before a dark background", *budget.nei_w_m2],
        ["NEDT at 300 K, K", *budget.nedt_k],
        ["irradiance of the target", *budget.light_w_m2],
        ["left by frame difference and wells", *budget.signals.irradiance_w_m2[0]],
        ["SNR of one look", *budget.signals.snr[0]],
    ]
    names = [term.name for term in budget.terms]
    columns = {
        band: np.array([term.sigma_w_m2[place] for term in budget.terms])
        for place, band in enumerate(budget.bands)
    }
    plot = bars(names, "standard deviation at the aperture, W/m²", columns)
    notes = [f"P_d of one look: {budget.signals.chance[0]:.4g}"]
    title = f"Noise of one look of {bench.sensor.id}, W/m2"
    return BenchResult(title, ("term", *budget.bands), rows, evolve(plot, log_y=True), notes)


def _waterfall(bench: Bench, budget: NoiseBudget, name: str) -> BenchResult:
    radiometer = bench.sensor.radiometer
    assert radiometer is not None
    band = _band_of(bench, name) if name else radiometer.reference
    steps = waterfall(budget, band, float(band_thresholds(bench.sensor)[band]))
    rows = [[step.name, step.gain_db, step.level_db, step.value] for step in steps]
    starts = np.array([step.level_db - step.gain_db for step in steps])
    line = BenchLine(budget.bands[band], starts, np.array([step.gain_db for step in steps]))
    plot = BenchPlot("", "level, dB", [line], [step.name for step in steps])
    title = f"From source to decision, {bench.sensor.id}, {budget.bands[band]}"
    margin = f"margin over the threshold: {steps[-1].level_db:.2f} dB"
    notes = [f"{margin}; P_d of one look: {budget.signals.chance[0]:.4g}"]
    return BenchResult(title, ("step", "gain dB", "level dB", "value"), rows, plot, notes)


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
    """Write one simulated frame of a focal plane as picture and array, or movies of frames."""
    bench = benches_of(arguments)[0]
    poses = _poses(arguments)
    band = _band_of(bench, arguments.band)
    folder = Path(arguments.out)
    if arguments.movie:
        films = _films(arguments, bench, poses, band)
        files = write_movies(films, folder)
        sys.stdout.write("".join(f"{_in_short(film)}\n" for film in films))
    else:
        files = write_frame(frame(bench, poses, arguments.pixels, arguments.seed, band), folder)
    for path in files:
        sys.stdout.write(f"{path}\n")
    return 0


def _films(arguments: argparse.Namespace, bench: Bench, poses: Poses, band: int) -> list[Clip]:
    """Return the clips of the arguments, each with a seed of its own."""
    if arguments.clips < 1:
        raise ModelError("--clips: give at least 1")
    scan_s = bench.sensor.scan.period_ns * 1e-9
    filming = Filming(
        frames=arguments.movie,
        every_s=scan_s if arguments.every is None else arguments.every,
        pixels=arguments.pixels,
        band=band,
        snr=arguments.snr,
    )
    seeds = range(arguments.seed, arguments.seed + arguments.clips)
    return [clip(bench, poses, filming, seed) for seed in seeds]


def _band_of(bench: Bench, name: str) -> int:
    """Return the number of a band by its name, the first for none."""
    names = [band.name for band in bench.sensor.bands]
    if name and name not in names:
        raise ModelError(f"--band: {name!r} is not one of {', '.join(names)}")
    return names.index(name) if name else 0


def _in_short(film: Clip) -> str:
    snr = film.snr[film.snr > 0.0]
    words = (
        f"SNR of its brightest pixel {snr.min():.3g} to {snr.max():.3g}"
        if len(snr)
        else "beside all frames"
    )
    of = f"{film.sensor} {film.band}, seed {film.seed}: {film.target_class}"
    return f"{of} in {len(snr)} of {len(film)} frames; {words}"


_RESULTS = {
    "budget": budget_of,
    "curve": _curve,
    "roc": _roc,
    "false-alarms": _false_alarms,
    "window": _window,
    "bands": _bands,
}
