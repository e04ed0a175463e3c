"""Closed forms of the focal plane against simulated frames: P_fa, P_d and centroid errors of 60
settings.

    python benchmarks/focal_plane.py [--frames 10000] [--write docs/benchmarks] [--from-csv
    docs/benchmarks]

Frames are those of `focal_plane_images`, which shares no code with the closed forms. `--write` puts
the page, its data as a CSV file and, where matplotlib is installed, a plot into a folder;
`--from-csv` draws page and plot again from the CSV file in a folder.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from focal_plane_images import Floats, Images, Outputs, centroid_errors, filtered, shares
from opir_photons.detection import cfar_loss, cfar_probability_of_detection, cfar_threshold
from opir_photons.radiometry import (
    FrameDifference,
    PointSpread,
    SpatialTransfer,
    centroid_sigma_rad,
    filter_weights,
    joined_centroid_variance,
    noise_gain,
    signal_gain,
)
from opir_photons.radiometry.focal_plane import centroid_factor_rad, photon_centroid_variance
from result_files import (
    BLUE,
    GREY,
    ORANGE,
    Row,
    column,
    markdown_table,
    read_csv,
    svg_plot,
    write_csv,
)
from scipy.special import ndtr

READ_E = 20.0
LEAST_BACKGROUND_E = 2e4
#: Reference cells of a threshold: the other places of a frame.
CELLS = 15

FILTERS = (("sum", 1), ("sum", 2), ("surround", 1), ("matched", 1))
#: Registration error of a frame and drift between two, pixels; None: no difference.
TEMPORAL = (None, (0.05, 0.0), (0.3, 0.0), (0.05, 0.4))
SPOTS = (0.3, 0.45, 0.7)
EXPONENTS = (8.0 / 3.0, 3.0, 3.5)
RATIOS = (0.5, 1.5, 4.0)
THRESHOLDS = (1.5, 2.0, 2.5, 3.0)
#: Mean SNR above the threshold.
SIGNALS = (-0.5, 0.5, 1.5, 3.0)
#: Noise that a threshold follows: of each frame, of all frames, of reference cells.
KINDS = ("frame", "fixed", "cells")

#: Width of the spot, noise of a pixel, electrons: from noise alone to photons alone.
CENTROIDS = tuple(
    (spot, noise, electrons)
    for spot in (0.35, 0.5, 0.8, 1.2)
    for noise, electrons in ((100.0, 2e4), (30.0, 1e4), (3.0, 4e3))
)

PAGE = """# The focal plane against simulated frames

*Are P_d, P_fa, clutter and centroid errors of a `focal_plane` those of real frames?* {settings} settings, {frames}
frames each: backgrounds with power-law spectra, spots on pixels, jitter, drift, Poisson and read noise, frame
differences, filters, thresholds.

{table}

*Within 95 %*: settings whose figure lies in the 95 % interval of the simulation around it. *Largest*: deviation, in
standard errors of the simulation; of {count} figures one is expected beyond {expected:.1f}.

![Simulated against closed-form P_d and P_fa, and their deviations in standard errors](focal_plane.svg)

**What the detection model simplifies.** The closed forms above are means over the sub-pixel phase of the target and the
displacement of the two frames, and count the photon noise of the target. `detection: snr` takes the mean phase, the
root mean square of the noise over frames, and no photon noise of the target. Its P_d is off by {simplified}. With a
threshold that does not follow the noise of each frame, P_fa is up to {tail:.1f} times Q(T) at {tail_sigma:g} σ; the
detection model lets it follow. Errors of centroids are within {joined:.1f} % of the formula of the detection model for
lines of sight, and within {bound:.1f} % of the bound.

**Method.** Frames are {pixels} pixels wide, 5 × 5 cells to a pixel, from the Fourier transform of white noise; {places}
targets a frame at random phases, and as many places without. Clutter is {low:g} to {high:g} times the noise. The code
that simulates shares nothing with the closed forms. All settings: [focal_plane.csv](focal_plane.csv).
"""


class Setting(NamedTuple):
    """One setting: the images, the filter's name, the kind of threshold, threshold and signal in σ,
    clutter ratio.
    """

    images: Images
    kind: str
    threshold_of: str
    threshold: float
    snr: float
    ratio: float


def settings(seed: int = 5) -> Iterator[Setting]:
    """Yield three settings for each pair of a spatial and a temporal filter, all else drawn at
    random.
    """
    rng = np.random.default_rng(seed)
    for kind, pixels in FILTERS:
        for temporal in TEMPORAL:
            for of in KINDS:
                spot, exponent, ratio, threshold, signal = (
                    float(rng.choice(each))
                    for each in (SPOTS, EXPONENTS, RATIOS, THRESHOLDS, SIGNALS)
                )
                # A structure that no filter takes the mean of is small beside the frame.
                is_whole = kind == "sum" and temporal is None
                scale = float(rng.choice((2.0, 3.0, 4.0) if is_whole else (3.0, 6.0, 12.0)))
                weights = filter_weights(kind, pixels, spot, 1.0)
                images = images_of(
                    weights, spot, scale, exponent, ratio, temporal, threshold + signal
                )
                yield Setting(images, f"{kind} {pixels}", of, threshold, threshold + signal, ratio)


def images_of(
    weights: Floats,
    spot: float,
    scale: float,
    exponent: float,
    ratio: float,
    temporal: tuple[float, float] | None,
    snr: float,
) -> Images:
    """Return frames with clutter `ratio` times the noise and targets of a mean SNR."""
    frames = None if temporal is None else FrameDifference(1.0, *temporal)
    registration, drift = temporal or (0.0, 0.0)
    left = float(
        SpatialTransfer.of(weights, PointSpread(np.inf, spot), 3.0).variance(
            scale, exponent, frames
        )
    )
    counted = noise_gain(weights) * (1 if temporal is None else 2)
    background_e = LEAST_BACKGROUND_E
    structure_e = 0.0
    for _ in range(200):
        # The background is six standard deviations of its structure above darkness, and makes the
        # noise.
        structure_e = ratio * np.sqrt(counted * (background_e + READ_E**2) / left)
        background_e = LEAST_BACKGROUND_E + 6.0 * structure_e
    sigma = np.sqrt((1.0 + ratio**2) * counted * (background_e + READ_E**2))
    target_e = snr * sigma / signal_gain(weights, spot, 1.0)
    return Images(
        spot,
        scale,
        exponent,
        structure_e,
        background_e,
        READ_E,
        registration,
        drift,
        temporal is not None,
        weights,
        target_e,
    )


class Noise:
    """Closed forms of a setting's noise: by the distance of its two frames."""

    def __init__(self, images: Images) -> None:
        self._images = images
        self._transfer = SpatialTransfer.of(images.weights, PointSpread(np.inf, images.spot), 6.0)
        self.white = (
            noise_gain(images.weights)
            * (images.background_e + images.read_e**2)
            * (1 + images.is_difference)
        )
        self._table = np.linspace(0.0, 6.0 * images.registration + images.drift + 1e-9, 400)
        self._left = (
            np.array([self._variance(0.0, moved) for moved in self._table])
            if images.is_difference
            else None
        )

    def _variance(self, registration: float, drift: float) -> float:
        frames = FrameDifference(1.0, registration, drift) if self._images.is_difference else None
        left = self._transfer.variance(self._images.scale, self._images.exponent, frames)
        return self.white + self._images.structure_e**2 * float(left)

    @property
    def sigma(self) -> float:
        """The standard deviation over all frames."""
        return float(np.sqrt(self._variance(self._images.registration, self._images.drift)))

    def sigma_moved(self, moved: Floats) -> Floats:
        """Return standard deviations of frames that are some distance apart."""
        if self._left is None:
            return np.full(np.shape(moved), self.sigma)
        return np.sqrt(np.interp(moved, self._table, self._left))

    def distances(self) -> tuple[Floats, Floats]:
        """Return nodes and weights of the distance of two frames: a drift and the errors of
        both.
        """
        node, weight = np.polynomial.hermite_e.hermegauss(24)
        spread = np.sqrt(2.0) * self._images.registration
        moved = np.hypot(self._images.drift + spread * node[:, None], spread * node)
        joint = np.outer(weight, weight) / weight.sum() ** 2
        return moved.ravel(), joint.ravel()


def expected(setting: Setting) -> tuple[float, float, float]:
    """Return P_fa and P_d in closed form, and the P_d of the detection model."""
    images = setting.images
    noise = Noise(setting.images)
    moved, weight = noise.distances()
    sigma = noise.sigma_moved(moved)[:, None]
    limit = setting.threshold * (noise.sigma if setting.threshold_of == "fixed" else sigma)
    node, share = np.polynomial.legendre.leggauss(12)
    phase = 0.5 * np.stack(np.meshgrid(node, node), axis=-1).reshape(-1, 2)
    of_phase = 0.25 * np.outer(share, share).ravel()
    parts = shares(images.spot, phase, len(images.weights))
    signal = images.target_e * (parts * images.weights).sum(axis=(1, 2))
    own = images.target_e * (parts * images.weights**2).sum(axis=(1, 2))
    spread = np.sqrt(sigma**2 + own)
    if setting.threshold_of == "cells":
        chance = float(ndtr(-setting.threshold))
        # The target's own photons spread the tested cell, not the reference cells.
        wider = np.sqrt((own / sigma**2 + 1.0 + 1.0 / CELLS) / (1.0 + 1.0 / CELLS))
        limit = cfar_threshold(chance, CELLS) / wider
        found = cfar_probability_of_detection(signal / sigma / wider, limit, CELLS)
        model = float(ndtr(setting.snr / cfar_loss(chance, CELLS) - setting.threshold))
        return chance, float(weight @ found @ of_phase), model
    false = float(weight @ ndtr(-limit / sigma)[:, 0])
    found = ndtr((signal - limit) / spread)
    return false, float(weight @ found @ of_phase), float(ndtr(setting.snr - setting.threshold))


def crossed(setting: Setting, outputs: Outputs) -> tuple[Floats, Floats]:
    """Return the shares (frames,) of places that cross the threshold, without and with a target."""
    images = setting.images
    noise = Noise(setting.images)
    mean = 0.0 if images.is_difference else float(images.weights.sum()) * images.background_e
    empty = outputs.empty - mean
    target = outputs.target - mean
    if setting.threshold_of == "cells":
        limit = float(cfar_threshold(ndtr(-setting.threshold), CELLS)) * np.sqrt(1.0 + 1.0 / CELLS)
        others = (empty.sum(axis=1, keepdims=True) - empty) / CELLS
        squares = (np.square(empty).sum(axis=1, keepdims=True) - np.square(empty)) / CELLS
        spread = np.sqrt((squares - others**2) * CELLS / (CELLS - 1))
        return ((empty - others) > limit * spread).mean(axis=1), (
            (target - others) > limit * spread
        ).mean(axis=1)
    sigma = (
        noise.sigma
        if setting.threshold_of == "fixed"
        else noise.sigma_moved(outputs.moved)[:, None]
    )
    return (empty > setting.threshold * sigma).mean(axis=1), (
        target > setting.threshold * sigma
    ).mean(axis=1)


def compared(setting: Setting, frames: int, rng: np.random.Generator) -> Row:
    """Return the row of a setting."""
    outputs = filtered(setting.images, frames, rng)
    shares_crossed = crossed(setting, outputs)
    images = setting.images
    figures = {}
    *closed, model = expected(setting)
    for name, share, chance in zip(("p_fa", "p_d"), shares_crossed, closed, strict=True):
        # Where few cross, their number is as good as Poisson distributed.
        error = max(
            share.std(ddof=1), np.sqrt(chance * (1.0 - chance) / outputs.empty.shape[1])
        ) / np.sqrt(frames)
        figures |= {
            name: f"{share.mean():.6f}",
            f"{name}_closed": f"{chance:.6f}",
            f"{name}_error": f"{error:.2e}",
        }
    return {
        "kind": "threshold",
        "filter": setting.kind,
        "difference": "yes" if images.is_difference else "no",
        "registration_px": f"{images.registration:g}",
        "drift_px": f"{images.drift:g}",
        "spot_px": f"{images.spot:g}",
        "scale_px": f"{images.scale:g}",
        "exponent": f"{images.exponent:.3g}",
        "clutter_over_noise": f"{setting.ratio:g}",
        "threshold_of": setting.threshold_of,
        "threshold_sigma": f"{setting.threshold:g}",
        "snr": f"{setting.snr:g}",
        "frames": str(frames),
        **figures,
        "p_d_model": f"{model:.6f}",
        "centroid_px": "",
        "centroid_px_closed": "",
        "centroid_px_error": "",
        "centroid_px_model": "",
    }


def compared_centroid(
    spot: float, noise_e: float, target_e: float, frames: int, rng: np.random.Generator
) -> Row:
    """Return the row of a centroid's error: root mean square along both axes."""
    off = centroid_errors(spot, noise_e, target_e, frames, rng)
    square = np.square(off).mean(axis=1)
    found = float(np.sqrt(square.mean()))
    white = (float(centroid_factor_rad(spot, 1.0)) * noise_e / target_e) ** 2
    joined = joined_centroid_variance(white, float(photon_centroid_variance(spot, 1.0)) / target_e)
    figures = {
        "kind": "centroid",
        "spot_px": f"{spot:g}",
        "snr": f"{target_e / noise_e:g}",
        "frames": str(frames),
        "centroid_px": f"{found:.6f}",
        "centroid_px_closed": f"{float(centroid_sigma_rad(target_e / noise_e, spot, 1.0, target_e)):.6f}",
        "centroid_px_error": f"{square.std(ddof=1) / np.sqrt(frames) / (2.0 * found):.2e}",
        "centroid_px_model": f"{float(np.sqrt(joined)):.6f}",
    }
    empty = dict.fromkeys(compared_columns(), "")
    return {**empty, **figures}


def compared_columns() -> tuple[str, ...]:
    """Return the columns of the data, in order."""
    own = (
        "kind filter difference registration_px drift_px spot_px scale_px exponent"
        " clutter_over_noise threshold_of"
    )
    rest = (
        "threshold_sigma snr frames p_fa p_fa_closed p_fa_error p_d p_d_closed p_d_error p_d_model"
    )
    return (
        *own.split(),
        *rest.split(),
        *("centroid_px" + end for end in ("", "_closed", "_error", "_model")),
    )


def deviations(rows: list[Row], name: str) -> Floats:
    """Return the deviations of a figure from its closed form, in standard errors."""
    own = [row for row in rows if row[name]]
    found, closed, error = (
        np.array(column(own, f"{name}{end}")) for end in ("", "_closed", "_error")
    )
    return np.asarray((found - closed) / error)


def page_of(rows: list[Row]) -> str:
    """Return the page."""
    from focal_plane_images import PIXELS, STEP

    threshold = [row for row in rows if row["kind"] == "threshold"]
    centroid = [row for row in rows if row["kind"] == "centroid"]
    names = (("P_fa", "p_fa"), ("P_d", "p_d"), ("centroid error", "centroid_px"))
    lines = []
    everything = []
    for title, name in names:
        off = deviations(rows, name)
        everything.append(off)
        lines.append(
            (title, str(len(off)), str(int((np.abs(off) < 1.96).sum())), f"{np.abs(off).max():.1f}")
        )
    count = sum(len(off) for off in everything)
    from scipy.special import ndtri

    model = np.abs(np.array(column(threshold, "p_d_model")) - column(threshold, "p_d"))
    kinds = ("without a frame difference", "with one")
    of_kind = np.array([row["difference"] == "yes" for row in threshold])
    parts = [
        f"{np.median(model[of_kind == flag]):.3f} in the median and"
        f" {model[of_kind == flag].max():.3f} at most {kind}"
        for kind, flag in zip(kinds, (False, True), strict=True)
    ]
    fixed = [
        row for row in threshold if row["threshold_of"] == "fixed" and row["difference"] == "yes"
    ]
    tails = [float(row["p_fa"]) / float(ndtr(-float(row["threshold_sigma"]))) for row in fixed]
    found, closed, joined = (
        np.array(column(centroid, f"centroid_px{end}")) for end in ("", "_closed", "_model")
    )
    return PAGE.format(
        settings=len(rows),
        frames=rows[0]["frames"],
        table=markdown_table(("figure", "settings", "within 95 %", "largest"), lines),
        count=count,
        expected=-float(ndtri(0.5 / count)),
        simplified=", ".join(parts),
        tail=max(tails),
        tail_sigma=float(fixed[int(np.argmax(tails))]["threshold_sigma"]),
        joined=100.0 * np.abs(found / joined - 1.0).max(),
        bound=100.0 * np.abs(found / closed - 1.0).max(),
        pixels=PIXELS,
        places=len(range(0, PIXELS - 5 + 1, STEP)) ** 2,
        low=min(RATIOS),
        high=max(RATIOS),
    )


def draw(rows: list[Row], path: Path) -> None:
    """Draw the plot."""
    threshold = [row for row in rows if row["kind"] == "threshold"]
    with svg_plot(path, 1, 2, figsize=(8.0, 3.6)) as (_, (left, right)):
        for name, colour, title in (("p_d", BLUE, "P_d"), ("p_fa", ORANGE, "P_fa")):
            closed = column(threshold, f"{name}_closed")
            found = column(threshold, name)
            error = 1.96 * np.array(column(threshold, f"{name}_error"))
            left.errorbar(closed, found, error, fmt="o", ms=3, color=colour, label=title, lw=1)
        left.plot([3e-4, 1.0], [3e-4, 1.0], color=GREY, lw=0.8)
        left.set(xscale="log", yscale="log", xlabel="closed form", ylabel="simulated")
        left.legend()
        edges = np.linspace(-4.0, 4.0, 17)
        together = [deviations(rows, name) for name in ("p_d", "p_fa", "centroid_px")]
        right.hist(
            together,
            edges,
            stacked=True,
            color=[BLUE, ORANGE, GREY],
            label=["P_d", "P_fa", "centroid"],
        )
        normal = np.diff(ndtr(edges)) * sum(len(each) for each in together)
        right.step(
            edges,
            np.append(normal, normal[-1]),
            where="post",
            color="black",
            lw=1,
            label="standard normal",
        )
        right.set(xlabel="deviation, standard errors", ylabel="settings")
        right.legend()


def write(rows: list[Row], folder: Path) -> None:
    """Write page, data and plot into a folder."""
    write_csv(folder / "focal_plane.csv", rows)
    (folder / "focal_plane.md").write_text(page_of(rows), encoding="utf-8")
    try:
        draw(rows, folder / "focal_plane.svg")
    except ImportError:
        print("no matplotlib: no plot")


def main() -> None:
    """Simulate, compare and write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--frames", type=int, default=10_000)
    parser.add_argument("--write", type=Path)
    parser.add_argument("--from-csv", type=Path)
    arguments = parser.parse_args()
    if arguments.from_csv:
        write(read_csv(arguments.from_csv / "focal_plane.csv"), arguments.from_csv)
        return
    rows: list[Row] = []
    for number, setting in enumerate(settings()):
        rows.append(compared(setting, arguments.frames, np.random.default_rng([2026, number])))
        print(
            {
                name: rows[-1][name]
                for name in ("filter", "threshold_of", "p_fa", "p_fa_closed", "p_d", "p_d_closed")
            }
        )
    for number, (spot, noise_e, target_e) in enumerate(CENTROIDS):
        rng = np.random.default_rng([2027, number])
        rows.append(compared_centroid(spot, noise_e, target_e, arguments.frames, rng))
    for name in ("p_fa", "p_d", "centroid_px"):
        print(name, np.round(deviations(rows, name), 1).tolist())
    if arguments.write:
        write(rows, arguments.write)


if __name__ == "__main__":
    main()
