"""What a tracker's estimates must be: of the shapes stated, on the Earth, chances, and covariances."""

from collections.abc import Mapping

import numpy as np
from attrs import fields

from opir_core.arrays import FloatArray
from opir_core.records import Tracks
from opir_core.scene import REPORTED_TYPES
from opir_core.testing.broken import Broken, insist

#: Relative tolerance of symmetry, and how far below zero rounding may take the least eigenvalue of a correlation.
_SYMMETRY = 1e-9
_LEAST_EIGENVALUE = -1e-9


def lawful(tracks: Tracks) -> Mapping[str, bool]:
    """Return what estimates must keep to, in words, and whether they do."""
    rows = len(tracks)
    shapes = {name: getattr(Tracks.empty(), name).shape[1:] for name in (item.name for item in fields(Tracks))}
    chances = tracks.type_probability
    known = ~np.isnan(chances).any(axis=1) if chances.ndim == 2 else np.zeros(0, dtype=bool)
    return {
        **{
            f"{name}: of shape {(rows, *shape)}": _shape(tracks, name) == (rows, *shape)
            for name, shape in shapes.items()
        },
        **{f"{name}: latitude and longitude": _are_places(getattr(tracks, name)) for name in ("launch", "impact")},
        f"type_probability: over {', '.join(REPORTED_TYPES)}, summing to 1": bool(
            np.all(chances[known] >= 0.0) and np.all(np.abs(chances[known].sum(axis=1) - 1.0) < 1e-6)
        ),
        **{
            f"{name}: positive and rising": _are_radii(getattr(tracks, name))
            for name in ("impact_sigmas", "state_sigmas")
        },
    }


def _are_radii(sigmas: FloatArray) -> bool:
    steps = np.diff(sigmas, axis=1, prepend=0.0)
    return not np.any(steps <= 0.0)


def _shape(tracks: Tracks, name: str) -> tuple[int, ...]:
    shape: tuple[int, ...] = getattr(tracks, name).shape
    return shape


def _are_places(places: FloatArray) -> bool:
    latitude, longitude = np.nan_to_num(places[:, 0]), np.nan_to_num(places[:, 1])
    return bool(np.all(np.abs(latitude) <= np.pi / 2) and np.all(np.abs(longitude) <= np.pi + 1e-12))


def insist_covariance(what: str, covariance: FloatArray) -> None:
    """Refuse covariances (n, d, d) that are not symmetric or not positive, or known in part."""
    unknown = np.isnan(covariance).any(axis=(1, 2))
    partly = unknown & ~np.isnan(covariance).all(axis=(1, 2))
    insist(not partly.any(), f"{what} is partly nan", "Give a whole covariance, or nan in all of it.")
    for matrix in covariance[~unknown]:
        deviation = np.sqrt(np.abs(np.diag(matrix)))
        if not np.all(np.diag(matrix) > 0.0):
            raise Broken(f"{what} has a variance that is not positive", "Use Joseph's or a square-root form.")
        correlation = matrix / np.outer(deviation, deviation)
        insist(
            bool(np.all(np.abs(correlation - correlation.T) <= _SYMMETRY)),
            f"{what} is not symmetric",
            "Compute one triangle and mirror it, or use a square-root form.",
        )
        least = float(np.linalg.eigvalsh(correlation)[0])
        insist(
            least > _LEAST_EIGENVALUE,
            f"{what} has a negative eigenvalue ({least:.1e} of its correlation)",
            "Use Joseph's or a square-root form.",
        )
