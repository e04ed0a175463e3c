"""Force models of free flight: descriptions, light to import. The arithmetic is in
`gravity_and_drag`.
"""

from collections.abc import Iterable
from typing import Literal

import numpy as np
from attrs import cmp_using, evolve, field, frozen
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray, RowArray
from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S, ZONAL_FORCES

#: The force model of a point mass alone, propagated in closed form.
KEPLER: Literal["kepler"] = "kepler"


@frozen
class ZonalField:
    """A gravity field symmetric about the Earth's axis.

    J_n = -√(2n+1) · C̄_n0, with C̄_n0 the normalised tide-free coefficients of EGM96
    (NASA/TP-1998-206861) and its reference radius; the gravitational constant is that of WGS 84.
    """

    mu_m3_s2: float = EARTH_MU_M3_S2
    radius_m: float = 6378136.3
    j2: float = 1.082626683553e-3
    j3: float = -2.532656485332e-6
    j4: float = -1.619621591367e-6


@frozen
class ExponentialAtmosphere:
    """An atmosphere of density `density_kg_m3` at `base_height_m`, which falls by e with every
    `scale_height_m`.

    Heights are geodetic, above the WGS 84 ellipsoid. Valid from 5 km below it upwards.
    """

    density_kg_m3: float = field()
    scale_height_m: float = field()
    base_height_m: float = 0.0

    @density_kg_m3.validator
    @scale_height_m.validator
    def _is_positive(self, attribute: object, value: float) -> None:
        if not 0.0 < value < np.inf:
            raise ValueError(
                f"{getattr(attribute, 'name', 'value')} must be positive and finite, got {value!r}"
            )


#: The U.S. Standard Atmosphere of 1976, to 1000 km.
US_STANDARD_1976: Literal["us_standard_1976"] = "us_standard_1976"


def _read_only(value: ArrayLike) -> FloatArray:
    array = np.array(value, dtype=np.float64)
    array.flags.writeable = False
    return array


@frozen
class Drag:
    """Drag by air that rotates with the Earth: -rho |w| w / (2 beta), with w the velocity relative
    to the air.

    `ballistic_coefficient_kg_m2` is beta = m/(C_d A), one number or an array that broadcasts
    against the leading axes of the states. `air_rotation_rad_s` is the angular velocity of the air
    about the Earth's axis.
    """

    ballistic_coefficient_kg_m2: FloatArray = field(
        converter=_read_only, eq=cmp_using(eq=np.array_equal), hash=False
    )
    atmosphere: ExponentialAtmosphere | Literal["us_standard_1976"] = field(
        default=US_STANDARD_1976
    )
    air_rotation_rad_s: float = EARTH_ROTATION_RAD_S

    @ballistic_coefficient_kg_m2.validator
    def _is_positive(self, _attribute: object, value: FloatArray) -> None:
        if not bool(np.all((value > 0.0) & (value < np.inf))):
            raise ValueError("ballistic_coefficient_kg_m2 must be positive and finite")

    @atmosphere.validator
    def _is_known(self, _attribute: object, value: object) -> None:
        if not isinstance(value, ExponentialAtmosphere) and value != US_STANDARD_1976:
            raise ValueError(
                f"atmosphere must be {US_STANDARD_1976!r} or an ExponentialAtmosphere, got"
                f" {value!r}"
            )


def _names(value: Iterable[str]) -> tuple[str, ...]:
    return tuple(value)


@frozen
class Forces:
    """The point mass, the zonal harmonics named, and drag if there is any.

    `Forces(zonal=())` and the word "kepler" are the two-body problem, solved in closed form.
    """

    zonal: tuple[str, ...] = field(default=("j2",), converter=_names)
    drag: Drag | None = None
    gravity: ZonalField = field(factory=ZonalField)

    @zonal.validator
    def _are_known(self, _attribute: object, value: tuple[str, ...]) -> None:
        unknown = sorted(set(value) - set(ZONAL_FORCES))
        if unknown:
            raise ValueError(
                f"unknown zonal harmonics {', '.join(unknown)}; known are {', '.join(ZONAL_FORCES)}"
            )

    def with_ballistic_coefficients(self, value_kg_m2: ArrayLike) -> "Forces":
        """Return the forces with other ballistic coefficients, where there is drag."""
        if self.drag is None:
            return self
        return evolve(self, drag=evolve(self.drag, ballistic_coefficient_kg_m2=value_kg_m2))

    def broadcast(self, count: int) -> "Forces":
        """Return the forces on `count` bodies; `ValueError` for another number of ballistic
        coefficients.
        """
        if self.drag is None:
            return self
        return self.with_ballistic_coefficients(
            np.broadcast_to(self.drag.ballistic_coefficient_kg_m2, (count,))
        )

    def take(self, rows: RowArray) -> "Forces":
        """Return the forces on some of the bodies, after `broadcast`."""
        if self.drag is None:
            return self
        return self.with_ballistic_coefficients(self.drag.ballistic_coefficient_kg_m2[rows])

    @property
    def is_kepler(self) -> bool:
        """Return whether the motion is two-body."""
        return not self.zonal and self.drag is None


ForceModel = Forces | Literal["kepler"]

#: The point mass and the Earth's oblateness.
J2 = Forces(zonal=("j2",))


def forces_of(model: ForceModel) -> Forces:
    """Return the `Forces` of a force model; `ValueError` for a word other than "kepler"."""
    if isinstance(model, Forces):
        return model
    if model == KEPLER:
        return Forces(zonal=())
    raise ValueError(f'forces must be a Forces or "kepler", got {model!r}')
