from opir_coverage.bench.bands import (
    BandLimits as BandLimits,
    best_bands as best_bands,
)
from opir_coverage.bench.movie_files import (
    write_movies as write_movies,
)
from opir_coverage.bench.movies import (
    Clip as Clip,
    Filming as Filming,
    clip as clip,
)
from opir_coverage.bench.stand import (
    Bench as Bench,
    Poses as Poses,
)
from opir_coverage.computing import (
    computed_coverage as computed_coverage,
    coverage as coverage,
)
from opir_coverage.grid import (
    PlaceGrid as PlaceGrid,
)
from opir_coverage.layers import (
    CoverageMap as CoverageMap,
    Layer as Layer,
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
from opir_coverage.settings import (
    CoverageSettings as CoverageSettings,
    Requirement as Requirement,
)
from opir_coverage.stereo import (
    dilution_m as dilution_m,
    stereo_angles_rad as stereo_angles_rad,
)
