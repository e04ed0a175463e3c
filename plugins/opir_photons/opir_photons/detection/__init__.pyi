from opir_photons.detection.band_rules import (
    RatioGates as RatioGates,
)
from opir_photons.detection.cfar import (
    cfar_loss as cfar_loss,
    cfar_probability_of_detection as cfar_probability_of_detection,
    cfar_threshold as cfar_threshold,
)
from opir_photons.detection.correlated_looks import (
    effective_looks as effective_looks,
)
from opir_photons.detection.focal_planes import (
    blur_rad as blur_rad,
    unlit_electrons_per_s as unlit_electrons_per_s,
)
from opir_photons.detection.fused_bands import (
    FusedBands as FusedBands,
)
from opir_photons.detection.latency import (
    cumulative_probability as cumulative_probability,
    latency_cdf as latency_cdf,
    latency_mean as latency_mean,
    latency_quantile as latency_quantile,
)
from opir_photons.detection.threshold import (
    false_alarm_probability as false_alarm_probability,
    m_of_n_probability as m_of_n_probability,
    probability_of_detection as probability_of_detection,
    threshold_sigma as threshold_sigma,
)
