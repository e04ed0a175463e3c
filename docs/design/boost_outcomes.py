"""Which ranges do the boosts of the tracker's prior have? What `vehicles.json` keeps under
`marginal`.

python docs/design/boost_outcomes.py [--draws 60000] [--seed 1]
"""

import argparse
import json

from opir_forecast.marginals import marginal_of
from opir_forecast.vehicles import vehicle_model


def main() -> None:
    """Print what belongs under `marginal`."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--draws", type=int, default=60000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    print(json.dumps(marginal_of(vehicle_model(), options.draws, options.seed)))


if __name__ == "__main__":
    main()
