"""Movies as files: FITS or arrays with the truth, and training sets of pictures and labels.

The folders are those of public sets of small infrared targets (NUDT-SIRST, IRSTD-1k): `images/` and
`masks/` of one PNG a frame with the same name, and lists of names for training and test. Labels are
YOLO's (`labels/`) and COCO's.
"""

import json
import struct
import zlib
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from opir_bench.movies import Clip, training_clips
from opir_core.arrays import ByteArray
from opir_core.output import OutputFiles

#: Percentiles of a clip's electrons that are black and white in its pictures.
_BLACK_WHITE = (0.05, 99.95)


def write_movies(clips: Sequence[Clip], folder: Path) -> list[Path]:
    """Write clips with pictures, masks and labels into a folder, all or none; return main files."""
    kind = "fits" if find_spec("astropy") else "npz"
    main = [folder / "clips" / f"clip{number:03d}.{kind}" for number in range(len(clips))]
    with OutputFiles(folder=folder) as files:
        for name in ("clips", "images", "masks", "labels", "img_idx"):
            files.make_folder(folder / name, parents=True)
        for path, clip in zip(main, clips, strict=True):
            with files.writing(path, "frames") as file_part:
                (_write_fits if kind == "fits" else _write_arrays)(clip, file_part)
        for number, clip in enumerate(clips):
            _write_pictures(files, folder, number, clip)
        for name, text in {**_lists(clips, folder.resolve().name), **_coco(clips)}.items():
            files.write(folder / name, text.encode(), "labels")
    return [*main, *(folder / name for name in ("images", "masks", "labels", "annotations.json"))]


def frame_name(clip: int, number: int) -> str:
    """Return the name of a frame without its ending."""
    return f"clip{clip:03d}_{number:04d}"


def _truth(clip: Clip) -> Mapping[str, NDArray[Any]]:
    """Return the columns of each frame's truth."""
    names = ("time_s", "row", "column", "light_w_m2", "snr")
    return {name: np.asarray(getattr(clip, name)) for name in names}


def _write_arrays(clip: Clip, path: Path) -> None:
    with path.open("wb") as stream:
        arrays: dict[str, Any] = {"electrons": clip.electrons, "mask": clip.mask, **_truth(clip)}
        np.savez_compressed(stream, **arrays)


def _write_fits(clip: Clip, path: Path) -> None:
    from astropy.io import fits  # type: ignore[import-untyped]

    frames = fits.PrimaryHDU(clip.electrons)
    header: dict[str, tuple[Any, str]] = {
        "BUNIT": ("electron", "counts of a frame"),
        "INSTRUME": (clip.sensor, "sensor"),
        "FILTER": (clip.band, "band"),
        "OBJECT": (clip.target_class, "class of the target"),
        "IFOV": (1e6 * clip.pixel_rad, "angle across a pixel, urad"),
        "SCALE": (clip.scale, "factor on the light of the target"),
        "SEED": (clip.seed, "of background, place and noise"),
        "ORIGIN": ("opir", "simulated, notional"),
    }
    frames.header.update(header)
    mask = fits.ImageHDU(clip.mask.astype(np.uint8), name="MASK")
    columns = [
        fits.Column(name=name, format="D", array=values) for name, values in _truth(clip).items()
    ]
    table = fits.BinTableHDU.from_columns(columns, name="TRUTH")
    with path.open("wb") as stream:
        fits.HDUList([frames, mask, table]).writeto(stream)


def _write_pictures(files: OutputFiles, folder: Path, number: int, clip: Clip) -> None:
    """Write the pictures, masks and YOLO labels of a clip; its frames share one grey scale."""
    grey = _grey(clip.electrons)
    rows, columns = grey.shape[1:]
    for step, box in enumerate(clip.boxes()):
        name = frame_name(number, step)
        files.write(folder / "images" / f"{name}.png", grey_png(grey[step]), "frame")
        files.write(
            folder / "masks" / f"{name}.png", grey_png(clip.mask[step] * np.uint8(255)), "mask"
        )
        files.write(folder / "labels" / f"{name}.txt", _yolo(box, rows, columns).encode(), "labels")


def _grey(electrons: NDArray[np.float32]) -> ByteArray:
    """Return grey levels that are linear in electrons."""
    black, white = np.percentile(electrons, _BLACK_WHITE)
    share = (electrons - black) / max(float(white - black), 1.0)
    return np.round(255.0 * np.clip(share, 0.0, 1.0)).astype(np.uint8)


def _yolo(box: tuple[int, int, int, int] | None, rows: int, columns: int) -> str:
    """Return the YOLO line of a box: class 0, middle, width, height in shares; or ""."""
    if box is None:
        return ""
    column, top, wide, tall = box
    middle = (column + 0.5 * wide) / columns, (top + 0.5 * tall) / rows
    return f"0 {middle[0]:.6f} {middle[1]:.6f} {wide / columns:.6f} {tall / rows:.6f}\n"


def _lists(clips: Sequence[Clip], name: str) -> Mapping[str, str]:
    """Return the lists of frames for training and test by the paths of NUDT-SIRST and IRSTD-1k."""
    names: dict[bool, str] = {True: "", False: ""}
    for number, (clip, trains) in enumerate(zip(clips, training_clips(len(clips)), strict=True)):
        names[trains] += "".join(f"{frame_name(number, step)}\n" for step in range(len(clip)))
    return {
        f"img_idx/train_{name}.txt": names[True],
        f"img_idx/test_{name}.txt": names[False],
        "trainval.txt": names[True],
        "test.txt": names[False],
    }


def _coco(clips: Sequence[Clip]) -> Mapping[str, str]:
    """Return the annotations of all frames in the format of COCO, with the SNR and the place."""
    images = list[dict[str, Any]]()
    annotations = list[dict[str, Any]]()
    classes = list(dict.fromkeys(clip.target_class for clip in clips))
    for number, clip in enumerate(clips):
        rows, columns = clip.mask.shape[1:]
        for step, box in enumerate(clip.boxes()):
            image = {
                "id": len(images) + 1,
                "file_name": f"{frame_name(number, step)}.png",
                "width": columns,
                "height": rows,
                "clip": number,
                "time_s": float(clip.time_s[step]),
            }
            images.append(image)
            if box is not None:
                category = classes.index(clip.target_class) + 1
                ids = {"id": len(annotations) + 1, "image_id": image["id"], "category_id": category}
                annotations.append({**ids, "bbox": list(box), **_annotation(clip, step)})
    categories = [{"id": place + 1, "name": name} for place, name in enumerate(classes)]
    annotated = {"images": images, "annotations": annotations, "categories": categories}
    return {"annotations.json": json.dumps(annotated, indent=1) + "\n"}


def _annotation(clip: Clip, step: int) -> dict[str, Any]:
    return {
        "area": int(clip.mask[step].sum()),
        "iscrowd": 0,
        "snr": float(clip.snr[step]),
        "center": [float(clip.column[step]) + 0.5, float(clip.row[step]) + 0.5],
    }


def grey_png(grey: ByteArray) -> bytes:
    """Return a picture of 8-bit grey levels (rows, columns) as PNG (ISO/IEC 15948)."""
    rows, columns = grey.shape
    lines = np.concatenate([np.zeros((rows, 1), dtype=np.uint8), grey], axis=1).tobytes()
    head = struct.pack(">IIBBBBB", columns, rows, 8, 0, 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(lines, 6)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(content))
        + name
        + content
        + struct.pack(">I", zlib.crc32(name + content))
        for name, content in chunks
    )
