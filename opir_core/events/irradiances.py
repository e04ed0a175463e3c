"""The irradiances that bands measured, as events carry them: an object by the name of the band."""

from collections.abc import Sequence

import msgspec
import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.events.lines import Piece, piece_table, taken
from opir_core.events.number_text import IRRADIANCE_DIGITS, number_texts, significant
from opir_core.protocols import Sensor
from opir_core.records import Detections

_json = msgspec.json.Encoder().encode


class IrradianceTexts:
    """Texts of measured irradiances, of the sensors of a run."""

    def __init__(self, sensors: Sequence[Sensor]) -> None:
        self._widths = np.array([len(sensor.bands) for sensor in sensors], dtype=np.int64)
        most = max((len(sensor.bands) for sensor in sensors), default=0)
        self._names = [piece_table(_name(sensor, place) for sensor in sensors) for place in range(most)]

    def pieces(self, detections: Detections, sensor: IntArray) -> list[Piece]:
        """Return `,"band_irradiance_w_m2":{...}`, in pieces; nothing where the detection model measures none."""
        measured = detections.band_irradiance_w_m2
        if not measured.shape[1]:
            return []
        pieces: list[Piece] = [b',"band_irradiance_w_m2":{']
        for place, names in enumerate(self._names):
            pieces += [taken(names, sensor), _texts(measured[:, place], self._widths[sensor] > place)]
        return [*pieces, b"}"]


def _name(sensor: Sensor, place: int) -> bytes:
    """Return the beginning of a band's entry; nothing for bands that the sensor has not."""
    if place >= len(sensor.bands):
        return b""
    return (b"," if place else b"") + _json(sensor.bands[place].name) + b":"


def _texts(irradiance_w_m2: FloatArray, is_there: BoolArray) -> list[bytes]:
    texts = number_texts(significant(irradiance_w_m2, IRRADIANCE_DIGITS))
    if is_there.all():
        return texts
    return [text if there else b"" for text, there in zip(texts, is_there.tolist(), strict=True)]
