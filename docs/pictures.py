"""Writes the pictures of the README and the pages, most from the gallery's scripts: `python
docs/pictures.py`.
"""

import os
import runpy
import warnings
from collections.abc import Sequence
from pathlib import Path

import matplotlib
from matplotlib import pyplot
from matplotlib.axes import Axes
from opir_bench import Bench, Clip, Filming, Poses, clip

DOCS = Path(__file__).resolve().parent
GALLERY = DOCS.parent / "examples" / "gallery"
#: The script of each picture, and the number of its figure.
PICTURES = {
    "pacific-map": ("plot_pacific_map", 1),
    "coverage-map": ("plot_coverage_map", 1),
}
#: Two clips, by their seeds, of the command of `how-to/train-detectors.md`.
CLIPS = (2, 4)


def main() -> None:
    """Run each script, and save one of its figures as PNG."""
    matplotlib.use("agg")
    warnings.filterwarnings("ignore", "FigureCanvasAgg is non-interactive")
    for name, (script, number) in PICTURES.items():
        pyplot.close("all")
        os.chdir(GALLERY)
        runpy.run_path(f"{script}.py", run_name="__main__")
        pyplot.figure(number).savefig(
            DOCS / "images" / f"{name}.png", dpi=130, metadata={"Software": None}
        )
    write_frame_clips()


def write_frame_clips() -> None:
    """Save the first and the last frame of clips with their masks as PNG."""
    bench = Bench.of_model("SBIRS-GEO")
    filming = Filming(frames=20, every_s=2.0, snr=(3.0, 30.0))
    pose = Poses.of("SRBM", height_m=30e3, speed_m_s=1000.0)
    figure, grid = pyplot.subplots(len(CLIPS), 4, figsize=(7.2, 3.9), layout="constrained")
    for axes, seed in zip(grid, CLIPS, strict=True):
        made = clip(bench, pose, filming, seed)
        draw_frame(axes[:2], made, 0)
        draw_frame(axes[2:], made, len(made) - 1)
    figure.savefig(DOCS / "images" / "frame-clips.png", dpi=110, metadata={"Software": None})


def draw_frame(axes: Sequence[Axes], made: Clip, number: int) -> None:
    """Draw a frame of a clip and its mask."""
    for each, picture in zip(axes, (made.electrons[number], made.mask[number]), strict=True):
        each.imshow(picture, cmap="gray")
        each.set_axis_off()
    axes[0].set_title(
        f"{made.time_s[number]:g} s, SNR {made.snr[number]:.2g}", fontsize=8, loc="left"
    )
    axes[1].set_title("mask", fontsize=8, loc="left")


if __name__ == "__main__":
    main()
