from opir_coverage.computing import (
    computed_coverage as computed_coverage,
    coverage as coverage,
)
from opir_coverage.grid import (
    PlaceGrid as PlaceGrid,
)
from opir_coverage.launches import (
    LaunchPlaces as LaunchPlaces,
    detection_of as detection_of,
    target_class_of as target_class_of,
)
from opir_coverage.layers import (
    CoverageMap as CoverageMap,
    Layer as Layer,
)
from opir_coverage.looks import (
    band_thresholds as band_thresholds,
)
from opir_coverage.maps import (
    layer_axes as layer_axes,
)
from opir_coverage.merits import (
    ages_of_data_s as ages_of_data_s,
    percent_below as percent_below,
    response_times_s as response_times_s,
    runs as runs,
    time_average_gap_s as time_average_gap_s,
)
from opir_coverage.number_lists import (
    numbers_of as numbers_of,
)
from opir_coverage.settings import (
    CoverageSettings as CoverageSettings,
    Requirement as Requirement,
)
from opir_coverage.stereo import (
    dilution_m as dilution_m,
    stereo_angles_rad as stereo_angles_rad,
)
from opir_coverage.watch import (
    first_report_s as first_report_s,
)
