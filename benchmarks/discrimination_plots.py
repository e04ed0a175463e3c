"""The plots of `discrimination.py`: shares reported, ROC curves and the confusion of types."""

from pathlib import Path
from typing import Any

import numpy as np
from discrimination_objects import CODES, KINDS, SENSORS, Looks, Population
from discrimination_statistics import interval, roc

from opir_core.scene.scene import REPORTED_TYPES, TARGET_TYPES


def plots(people: Population, looks: dict[str, Looks], folder: Path) -> None:
    """Draw the curves and the confusion of types."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "opir"
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 2, figsize=(11.0, 3.8), layout="constrained")
    draw_shares(axes[0], people, looks)
    draw_curves(axes[1], people, looks, "fire")
    axes[1].legend(frameon=False, loc="lower right")
    figure.savefig(folder / "discrimination.svg", metadata={"Date": None})
    figure, axes = pyplot.subplots(1, 3, figsize=(11.0, 3.4), sharey=True, layout="constrained")
    for axis, sensor in zip(axes, SENSORS, strict=True):
        draw_confusion(axis, people, looks[sensor])
        axis.set_title(sensor)
    axes[0].set_ylabel("true type")
    figure.savefig(folder / "classification.svg", metadata={"Date": None})


COLOURS = dict(zip(SENSORS, ("C1", "C0", "C2"), strict=True))


def draw_shares(axis: Any, people: Population, looks: dict[str, Looks]) -> None:
    """Draw what share of the objects of each kind is reported, with intervals."""
    kinds = (*TARGET_TYPES, *KINDS)
    for number, sensor in enumerate(SENSORS):
        for place, kind in enumerate(kinds):
            own = looks[sensor].code[people.kind == kind] < len(REPORTED_TYPES)
            share = float(own.mean())
            low, high = interval(int(own.sum()), len(own))
            axis.errorbar(
                place + 0.2 * (number - 1),
                100.0 * share,
                100.0 * np.array([[share - low], [high - share]]),
                fmt="o",
                color=COLOURS[sensor],
            )
    axis.set_xticks(range(len(kinds)), kinds)
    axis.set(ylabel="reported, %", ylim=(-3.0, 103.0))
    axis.grid(alpha=0.3)


def draw_curves(axis: Any, people: Population, looks: dict[str, Looks], kind: str) -> None:
    """Draw the curves of all sensors against a kind, with bands of resampled objects."""
    rng = np.random.default_rng(5)
    at = np.linspace(0.0, 1.0, 101)
    plume = np.isin(people.kind, TARGET_TYPES)
    other = people.kind == kind
    for sensor in SENSORS:
        score = looks[sensor].log_odds
        parts = score[plume], score[other]
        drawn = [roc(*(rng.choice(part, len(part)) for part in parts), at) for _ in range(200)]
        band = np.quantile(drawn, [0.025, 0.975], axis=0)
        axis.fill_between(at, *band, color=COLOURS[sensor], alpha=0.15, linewidth=0)
        axis.plot(at, roc(*parts, at), color=COLOURS[sensor], label=sensor)
    axis.set(
        xlabel=f"share of {kind}s above the threshold",
        ylabel="share of plumes above it",
        xlim=(-0.02, 1.02),
        ylim=(-0.02, 1.02),
    )
    axis.grid(alpha=0.3)


def draw_confusion(axis: Any, people: Population, looks: Looks) -> None:
    """Draw what looks at launches of each type are reported as, in percent with intervals."""
    for row, kind in enumerate(TARGET_TYPES):
        codes = looks.code[people.kind == kind]
        share = np.bincount(codes, minlength=len(CODES)) / len(codes)
        axis.imshow(
            share[None],
            vmin=0.0,
            vmax=1.0,
            cmap="Blues",
            aspect="auto",
            extent=(-0.5, 4.5, row + 0.5, row - 0.5),
        )
        for column, value in enumerate(share.tolist()):
            low, high = interval(round(value * len(codes)), len(codes))
            percent = f"{100 * value:.0f}\n{100 * low:.0f}–{100 * high:.0f}"
            ink = "white" if value > 0.6 else "black"
            axis.text(column, row, percent, ha="center", va="center", fontsize=8, color=ink)
    axis.set(xlim=(-0.5, 4.5), ylim=(2.5, -0.5))
    axis.set_xticks(range(5), [code.replace(" ", "\n") for code in CODES], fontsize=8)
    axis.set_yticks(range(3), TARGET_TYPES)
