from opir_core.interfaces.columns import (
    Columns as Columns,
    names_of as names_of,
)
from opir_core.interfaces.contexts import (
    PartMaker as PartMaker,
    Surroundings as Surroundings,
)
from opir_core.interfaces.contract import (
    PluginPart as PluginPart,
    has_own as has_own,
)
from opir_core.interfaces.directors import (
    command_fault as command_fault,
)
from opir_core.interfaces.impact_regions import (
    IMPACT_CONDITIONS as IMPACT_CONDITIONS,
)
from opir_core.interfaces.radiometric_models import (
    Structure as Structure,
)
from opir_core.interfaces.records import (
    IMPACT_METHODS as IMPACT_METHODS,
    TRACK_CONTAINMENTS as TRACK_CONTAINMENTS,
    TRACK_ENDS as TRACK_ENDS,
)
from opir_core.interfaces.sensors import Radiometer as Radiometer
from opir_core.interfaces.viewpoints import (
    Viewpoints as Viewpoints,
)
from opir_core.interfaces.weighed_tracks import (
    hypothesis_columns as hypothesis_columns,
)
