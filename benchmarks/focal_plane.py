"""Closed forms of the focal plane against simulated frames: P_fa, P_d and centroid errors of 60
settings.

Frames are those of `focal_plane_images`, which shares no code with the closed forms.
"""

from typing import NamedTuple

import numpy as np
from focal_plane_images import PIXELS, STEP, Images, centroid_errors, filtered, shares
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
from pages import COLOURS, GREY, Table, markdown_table, options_of, publish, svg_plot
from scipy.special import ndtr, ndtri

READ_E = 20.0
LEAST_BACKGROUND_E = 2e4
#: Reference cells of a threshold: the other places of a frame.
CELLS = 15
FILTERS = (("sum", 1), ("sum", 2), ("surround", 1), ("matched", 1))
#: Registration error of a frame and drift between two, pixels; None: no difference.
TEMPORAL = (None, (0.05, 0.0), (0.3, 0.0), (0.05, 0.4))
#: Clutter over noise.
RATIOS = (0.5, 1.5, 4.0)
#: Values of spot, exponent, clutter ratio, threshold, and mean SNR above the threshold.
DRAWN = (
    (0.3, 0.45, 0.7),
    (8.0 / 3.0, 3.0, 3.5),
    RATIOS,
    (1.5, 2.0, 2.5, 3.0),
    (-0.5, 0.5, 1.5, 3.0),
)
#: Noise that a threshold follows: of each frame, of all frames, of reference cells.
KINDS = ("frame", "fixed", "cells")
#: Width of the spot, noise of a pixel, electrons: from noise alone to photons alone.
CENTROIDS = tuple(
    (spot, noise, electrons)
    for spot in (0.35, 0.5, 0.8, 1.2)
    for noise, electrons in ((100.0, 2e4), (30.0, 1e4), (3.0, 4e3))
)

PAGE = """# The focal plane against simulated frames

*Are P_d, P_fa, clutter and centroid errors of a `focal_plane` those of real frames?* {settings}
settings, {frames} frames each: backgrounds with power-law spectra, spots on pixels, jitter, drift,
Poisson and read noise, frame differences, filters, thresholds.

{table}

*Within 95 %*: settings whose figure lies in the 95 % interval of the simulation around it.
*Largest*: deviation, in standard errors of the simulation; of {count} figures one is expected
beyond {expected:.1f}.

![Simulated against closed-form P_d and P_fa, and their deviations](focal_plane.svg)

**What the detection model simplifies.** The closed forms above are means over the sub-pixel phase
of the target and the displacement of the two frames, and count the photon noise of the target.
`detection: snr` takes the mean phase, the root mean square of the noise over frames, and no photon
noise of the target. Its P_d is off by {simplified}. With a threshold that does not follow the
noise of each frame, P_fa is up to {tail:.1f} times Q(T) at {tail_sigma:g} σ; the detection model
lets it follow. Errors of centroids are within {joined:.1f} % of the formula of the detection model
for lines of sight, and within {bound:.1f} % of the bound.

**Method.** Frames are {pixels} pixels wide, 5 × 5 cells to a pixel, from the Fourier transform of
white noise; {places} targets a frame at random phases, and as many places without. Clutter is
{low:g} to {high:g} times the noise. The code that simulates shares nothing with the closed forms.
All settings: [focal_plane.csv](focal_plane.csv).
"""
FIGURES = {"p_fa": "P_fa", "p_d": "P_d", "centroid_px": "centroid error"}


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


def settings(seed=5):
    """Yield three settings for each pair of a spatial and a temporal filter, all else drawn at
    random.
    """
    rng = np.random.default_rng(seed)
    for kind, pixels in FILTERS:
        for temporal in TEMPORAL:
            for threshold_of in KINDS:
                spot, exponent, ratio, threshold, signal = (
                    float(rng.choice(values)) for values in DRAWN
                )
                # A structure that no filter takes the mean of is small beside the frame.
                is_small = kind == "sum" and temporal is None
                scale = float(rng.choice((2.0, 3.0, 4.0) if is_small else (3.0, 6.0, 12.0)))
                weights = filter_weights(kind, pixels, spot, 1.0)
                snr = threshold + signal
                structure = {"spot": spot, "scale": scale, "exponent": exponent}
                images = images_of(weights, structure, ratio, temporal, snr)
                yield Setting(images, f"{kind} {pixels}", threshold_of, threshold, snr, ratio)


def images_of(
    weights,
    structure,
    ratio,
    temporal,
    snr,
):
    """Return frames with clutter `ratio` times the noise and targets of a mean SNR."""
    spot = structure["spot"]
    frames = None if temporal is None else FrameDifference(1.0, *temporal)
    registration, drift = temporal or (0.0, 0.0)
    transfer = SpatialTransfer.of(weights, PointSpread(np.inf, spot), 3.0)
    clutter = float(transfer.variance(structure["scale"], structure["exponent"], frames))
    counted = noise_gain(weights) * (1 if temporal is None else 2)
    background_e = LEAST_BACKGROUND_E
    structure_e = 0.0
    for _ in range(200):
        # The background is six standard deviations of its structure above darkness, and makes the
        # noise.
        structure_e = ratio * np.sqrt(counted * (background_e + READ_E**2) / clutter)
        background_e = LEAST_BACKGROUND_E + 6.0 * structure_e
    sigma = np.sqrt((1.0 + ratio**2) * counted * (background_e + READ_E**2))
    return Images(
        **structure,
        structure_e=structure_e,
        background_e=background_e,
        read_e=READ_E,
        registration=registration,
        drift=drift,
        is_difference=temporal is not None,
        weights=weights,
        target_e=snr * sigma / signal_gain(weights, spot, 1.0),
    )


class Noise:
    """Closed forms of a setting's noise: by the distance of its two frames."""

    def __init__(self, images):
        self._images = images
        self._transfer = SpatialTransfer.of(images.weights, PointSpread(np.inf, images.spot), 6.0)
        counted_e = images.background_e + images.read_e**2
        self.white = noise_gain(images.weights) * counted_e * (1 + images.is_difference)
        self._distances = np.linspace(0.0, 6.0 * images.registration + images.drift + 1e-9, 400)
        count = len(self._distances) if images.is_difference else 1
        self._variances = [self._variance(0.0, moved) for moved in self._distances[:count]]

    def _variance(self, registration, drift):
        images = self._images
        frames = FrameDifference(1.0, registration, drift) if images.is_difference else None
        clutter = self._transfer.variance(images.scale, images.exponent, frames)
        return self.white + images.structure_e**2 * float(clutter)

    @property
    def sigma(self):
        """The standard deviation over all frames."""
        return float(np.sqrt(self._variance(self._images.registration, self._images.drift)))

    def sigma_moved(self, moved):
        """Return standard deviations of frames at some distances."""
        if not self._images.is_difference:
            return np.full(np.shape(moved), self.sigma)
        return np.sqrt(np.interp(moved, self._distances, self._variances))

    def distances(self):
        """Return nodes and weights of the distance of two frames: a drift and the errors of
        both.
        """
        node, weight = np.polynomial.hermite_e.hermegauss(24)
        spread = np.sqrt(2.0) * self._images.registration
        moved = np.hypot(self._images.drift + spread * node[:, None], spread * node)
        joint = np.outer(weight, weight) / weight.sum() ** 2
        return moved.ravel(), joint.ravel()


def expected(setting):
    """Return P_fa and P_d in closed form, and the P_d of the detection model."""
    images = setting.images
    noise = Noise(images)
    moved, weight = noise.distances()
    sigma = noise.sigma_moved(moved)[:, None]
    node, share = np.polynomial.legendre.leggauss(12)
    phase = 0.5 * np.stack(np.meshgrid(node, node), axis=-1).reshape(-1, 2)
    phase_weight = 0.25 * np.outer(share, share).ravel()
    spots = images.target_e * shares(images.spot, phase, len(images.weights))
    signal = (spots * images.weights).sum(axis=(1, 2))
    photons = (spots * images.weights**2).sum(axis=(1, 2))
    if setting.threshold_of == "cells":
        false_alarm = float(ndtr(-setting.threshold))
        # The target's own photons spread the tested cell, not the reference cells.
        wider = np.sqrt((photons / sigma**2 + 1.0 + 1.0 / CELLS) / (1.0 + 1.0 / CELLS))
        limit = cfar_threshold(false_alarm, CELLS) / wider
        detected = cfar_probability_of_detection(signal / sigma / wider, limit, CELLS)
        snr = setting.snr / cfar_loss(false_alarm, CELLS)
    else:
        limit = setting.threshold * (noise.sigma if setting.threshold_of == "fixed" else sigma)
        false_alarm = float(weight @ ndtr(-limit / sigma)[:, 0])
        detected = ndtr((signal - limit) / np.sqrt(sigma**2 + photons))
        snr = setting.snr
    model = float(ndtr(snr - setting.threshold))
    return false_alarm, float(weight @ detected @ phase_weight), model


def crossed(setting, outputs):
    """Return the shares (frames,) of places that cross the threshold, without and with a target."""
    images = setting.images
    mean = 0.0 if images.is_difference else float(images.weights.sum()) * images.background_e
    empty = outputs.empty - mean
    target = outputs.target - mean
    if setting.threshold_of == "cells":
        cells = (empty.sum(axis=1, keepdims=True) - empty) / CELLS
        squares = (np.square(empty).sum(axis=1, keepdims=True) - np.square(empty)) / CELLS
        spread = np.sqrt((squares - cells**2) * CELLS / (CELLS - 1))
        factor = float(cfar_threshold(ndtr(-setting.threshold), CELLS)) * np.sqrt(1.0 + 1.0 / CELLS)
        limit = cells + factor * spread
    else:
        noise = Noise(images)
        is_fixed = setting.threshold_of == "fixed"
        sigma = noise.sigma if is_fixed else noise.sigma_moved(outputs.moved)[:, None]
        limit = setting.threshold * sigma
    return (empty > limit).mean(axis=1), (target > limit).mean(axis=1)


def threshold_row(setting, frames, rng):
    """Return the row of a setting."""
    images = setting.images
    outputs = filtered(images, frames, rng)
    false_alarm, detection, model = expected(setting)
    row = {
        "kind": "threshold",
        "filter": setting.kind,
        "difference": "yes" if images.is_difference else "no",
        "registration_px": images.registration,
        "drift_px": images.drift,
        "spot_px": images.spot,
        "scale_px": images.scale,
        "exponent": images.exponent,
        "clutter_over_noise": setting.ratio,
        "threshold_of": setting.threshold_of,
        "threshold_sigma": setting.threshold,
        "snr": setting.snr,
        "frames": frames,
    }
    closed = {"p_fa": false_alarm, "p_d": detection}
    places = outputs.empty.shape[1]
    for (name, chance), share in zip(closed.items(), crossed(setting, outputs), strict=True):
        # Where few cross, their number is as good as Poisson distributed.
        sigma = max(float(share.std(ddof=1)), np.sqrt(chance * (1.0 - chance) / places))
        row |= {name: float(share.mean()), f"{name}_closed": chance}
        row[f"{name}_error"] = float(sigma / np.sqrt(frames))
    ends = ("", "_closed", "_error", "_model")
    return row | {"p_d_model": model, **{f"centroid_px{end}": "" for end in ends}}


def centroid_row(columns, centroid, frames, rng):
    """Return the row of a centroid's error: root mean square along both axes."""
    spot, noise_e, target_e = centroid
    square = np.square(centroid_errors(spot, noise_e, target_e, frames, rng)).mean(axis=1)
    error_px = float(np.sqrt(square.mean()))
    snr = target_e / noise_e
    white = (float(centroid_factor_rad(spot, 1.0)) / snr) ** 2
    joined = joined_centroid_variance(white, float(photon_centroid_variance(spot, 1.0)) / target_e)
    return dict.fromkeys(columns, "") | {
        "kind": "centroid",
        "spot_px": spot,
        "snr": snr,
        "frames": frames,
        "centroid_px": error_px,
        "centroid_px_closed": float(centroid_sigma_rad(snr, spot, 1.0, target_e)),
        "centroid_px_error": float(square.std(ddof=1) / np.sqrt(frames) / (2.0 * error_px)),
        "centroid_px_model": float(np.sqrt(joined)),
    }


def rows_of(frames):
    """Yield the rows of all settings and centroids."""
    columns = {}
    for number, setting in enumerate(settings()):
        columns = threshold_row(setting, frames, np.random.default_rng([2026, number]))
        yield columns
    for number, centroid in enumerate(CENTROIDS):
        yield centroid_row(columns, centroid, frames, np.random.default_rng([2027, number]))


def deviations(table, name):
    """Return the deviations of a figure from its closed form, in standard errors."""
    rows = Table(row for row in table if row[name] != "")
    figure, closed, error = (
        np.array(rows.column(f"{name}{end}")) for end in ("", "_closed", "_error")
    )
    return np.asarray((figure - closed) / error)


def page(table):
    """Return the page."""
    threshold = table.where(kind="threshold")
    centroid = table.where(kind="centroid")
    scaled = {name: np.abs(deviations(table, name)) for name in FIGURES}
    count = sum(map(len, scaled.values()))
    lines = [
        (FIGURES[name], len(values), int((values < 1.96).sum()), f"{values.max():.1f}")
        for name, values in scaled.items()
    ]
    sentences = []
    for name, flag in (("without a frame difference", "no"), ("with one", "yes")):
        rows = threshold.where(difference=flag)
        model = np.abs(np.array(rows.column("p_d_model")) - rows.column("p_d"))
        sentences.append(
            f"{np.median(model):.3f} in the median and {model.max():.3f} at most {name}"
        )
    fixed = threshold.where(threshold_of="fixed", difference="yes")
    tails = [row["p_fa"] / float(ndtr(-row["threshold_sigma"])) for row in fixed]
    error_px = np.array(centroid.column("centroid_px"))

    def percent(end):
        return 100.0 * float(np.abs(error_px / centroid.column(f"centroid_px{end}") - 1.0).max())

    return PAGE.format(
        settings=len(table),
        frames=table[0]["frames"],
        table=markdown_table(("figure", "settings", "within 95 %", "largest"), lines),
        count=count,
        expected=-float(ndtri(0.5 / count)),
        simplified=", ".join(sentences),
        tail=max(tails),
        tail_sigma=fixed[int(np.argmax(tails))]["threshold_sigma"],
        joined=percent("_model"),
        bound=percent("_closed"),
        pixels=PIXELS,
        places=len(range(0, PIXELS - 5 + 1, STEP)) ** 2,
        low=min(RATIOS),
        high=max(RATIOS),
    )


def draw(path, table):
    """Draw simulated against closed-form figures, and the deviations."""
    threshold = table.where(kind="threshold")
    with svg_plot(path, 1, 2, figsize=(8.0, 3.6)) as (_, (left, right)):
        for colour, name in zip(COLOURS, ("p_d", "p_fa"), strict=False):
            figures = [threshold.column(f"{name}{end}") for end in ("_closed", "", "_error")]
            error = 1.96 * np.array(figures[2])
            style = {"fmt": "o", "ms": 3, "lw": 1, "color": colour, "label": FIGURES[name]}
            left.errorbar(*figures[:2], error, **style)
        left.plot([3e-4, 1.0], [3e-4, 1.0], color=GREY, lw=0.8)
        left.set(xscale="log", yscale="log", xlabel="closed form", ylabel="simulated")
        edges = np.linspace(-4.0, 4.0, 17)
        scaled = [deviations(table, name) for name in FIGURES]
        right.hist(scaled, edges, stacked=True, label=list(FIGURES.values()))
        normal = np.diff(ndtr(edges)) * sum(map(len, scaled))
        right.stairs(normal, edges, color="black", label="standard normal")
        right.set(xlabel="deviation, standard errors", ylabel="settings")


def main():
    """Simulate, compare and write."""
    options = options_of(__doc__, frames=10_000)
    publish(options, page, draw, focal_plane=rows_of(options.frames))


if __name__ == "__main__":
    main()
