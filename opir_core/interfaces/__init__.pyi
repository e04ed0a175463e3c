from opir_core.interfaces.columns import (
    Columns as Columns,
    as_slice_if_consecutive as as_slice_if_consecutive,
    names_of as names_of,
)
from opir_core.interfaces.contexts import (
    Surroundings as Surroundings,
)
from opir_core.interfaces.optional import (
    ConfirmingModel as ConfirmingModel,
)
from opir_core.interfaces.protocols import (
    Radiometer as Radiometer,
)
from opir_core.interfaces.radiometric_models import (
    CloudyTransmittance as CloudyTransmittance,
    CourseWithBreakpoints as CourseWithBreakpoints,
    ReflectingSignatures as ReflectingSignatures,
    SignaturesWithBreakpoints as SignaturesWithBreakpoints,
    Structure as Structure,
    StructuredBackground as StructuredBackground,
    TransmittanceWithBreakpoints as TransmittanceWithBreakpoints,
    intensities_w_sr as intensities_w_sr,
    radiances_and_clutter_w_m2_sr as radiances_and_clutter_w_m2_sr,
    transmittances as transmittances,
)
from opir_core.interfaces.records import (
    IMPACT_METHODS as IMPACT_METHODS,
    TRACK_CONTAINMENTS as TRACK_CONTAINMENTS,
)
