from opir_forecast.arc import (
    ArcForecaster as ArcForecaster,
)
from opir_forecast.ascents import (
    BoostAscents as BoostAscents,
    ascents_of as ascents_of,
)
from opir_forecast.configs import (
    RegionsConfig as RegionsConfig,
)
from opir_forecast.estimates import (
    BoostEstimates as BoostEstimates,
    burning_probability as burning_probability,
    launch_probability as launch_probability,
)
from opir_forecast.forecaster import (
    Forecaster as Forecaster,
)
from opir_forecast.launch_forecasts import (
    LaunchForecasts as LaunchForecasts,
)
from opir_forecast.launch_points import (
    AT_ONCE as AT_ONCE,
    BEFORE_S as BEFORE_S,
    EDGES_S as EDGES_S,
    FirstMotion as FirstMotion,
    Ground as Ground,
    LaunchDelayPrior as LaunchDelayPrior,
    LaunchPoints as LaunchPoints,
    are_in_orbit as are_in_orbit,
    delays_at_once as delays_at_once,
    grounds as grounds,
    launches as launches,
    log_unreported as log_unreported,
    on_ground as on_ground,
    path_moments as path_moments,
    site_height_m as site_height_m,
    updated_points as updated_points,
)
from opir_forecast.outcomes import (
    Outcomes as Outcomes,
    hypothesis_log_likelihood as hypothesis_log_likelihood,
)
from opir_forecast.region_forecaster import (
    RegionForecaster as RegionForecaster,
)
from opir_forecast.since_launch import (
    InFlight as InFlight,
    launch_of as launch_of,
)
from opir_forecast.single_sight import (
    AlongSight as AlongSight,
    Sighting as Sighting,
    along_sight as along_sight,
)
from opir_forecast.vehicles import (
    VehicleModel as VehicleModel,
    vehicle_model as vehicle_model,
)
