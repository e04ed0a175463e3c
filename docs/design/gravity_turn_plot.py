"""Height and speed against time of the preset stagings: the picture of the page
`explanation/gravity-turn.md`.
"""

from pathlib import Path

import matplotlib as mpl
import numpy as np

from opir_core.flight.staged.flights import StagedFlights, staged_flights
from opir_core.flight.staged.staging import stagings
from opir_core.geometry import Geodetic, ecef_to_geodetic, geodesic_direct

mpl.use("svg")
mpl.rcParams.update({"svg.hashsalt": "opir", "svg.fonttype": "none"})
from matplotlib import pyplot  # noqa: E402

PICTURE = Path(__file__).parents[1] / "explanation" / "gravity-turn.svg"

#: Staging and range of each curve, km.
SHOWN = {
    "SRBM": 300.0,
    "MRBM": 1300.0,
    "IRBM": 4000.0,
    "SLBM": 8000.0,
    "ICBM_solid": 10000.0,
    "ICBM_liquid": 10000.0,
}


def main() -> None:
    """Fly each staging eastwards from 40° N, and draw the boosts."""
    count = len(SHOWN)
    latitude = np.full(count, np.radians(40.0))
    zero = np.zeros(count)
    end = geodesic_direct(
        latitude, zero, np.full(count, 0.5 * np.pi), np.array(list(SHOWN.values())) * 1e3
    )
    aim = Geodetic(np.asarray(end.latitude_rad), np.asarray(end.longitude_rad), zero)
    chosen = [stagings()[name] for name in SHOWN]
    flights = staged_flights(Geodetic(latitude, zero, zero), aim, zero, chosen, zero, zero)
    figure, axes = pyplot.subplots(1, 2, layout="constrained", figsize=(9.0, 3.6))
    for row, (name, range_km) in enumerate(SHOWN.items()):
        time_s, height_km, speed_km_s = curve(flights, row)
        label = f"{name}, {range_km:g} km"
        (line,) = axes[0].plot(time_s, height_km, label=label)
        axes[1].plot(time_s, speed_km_s, color=line.get_color())
        for gap in zip(flights.burns_s[row, :-1, 1], flights.burns_s[row, 1:, 0], strict=True):
            if np.isfinite(gap).all():
                axes[1].axvspan(*gap, color=line.get_color(), alpha=0.25, linewidth=0)
    for panel, unit in zip(axes, ("height, km", "speed over the Earth, km/s"), strict=True):
        panel.set_xlabel("time since ignition, s")
        panel.set_ylabel(unit)
        panel.grid(alpha=0.3)
    axes[0].legend(fontsize="small")
    figure.savefig(PICTURE, metadata={"Date": None})


def curve(flights: StagedFlights, row: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, heights and speeds of a boost."""
    time_s = np.linspace(0.0, float(flights.burnout_s[row]), 200)
    position, velocity = flights.state(np.full(200, row), time_s)
    return (
        time_s,
        ecef_to_geodetic(position).height_m / 1e3,
        np.sqrt((velocity**2).sum(axis=1)) / 1e3,
    )


if __name__ == "__main__":
    main()
