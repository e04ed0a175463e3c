from opir_core.scene.fields import (
    info_of as info_of,
)
from opir_core.scene.hypotheses import (
    core_hypotheses as core_hypotheses,
    hypotheses_of as hypotheses_of,
)
from opir_core.scene.input_file import (
    NotAFileError as NotAFileError,
    file_bytes as file_bytes,
    text_of as text_of,
)
from opir_core.scene.plausibility import (
    implausible_defaults as implausible_defaults,
)
from opir_core.scene.quadrangle import (
    QuadrangleConfig as QuadrangleConfig,
)
from opir_core.scene.scene import (
    BY_OBSERVATION as BY_OBSERVATION,
    BY_REPORT as BY_REPORT,
    CLASS_TYPES as CLASS_TYPES,
    DEFAULT_SIGNATURE as DEFAULT_SIGNATURE,
    MAXIMUM_BANDS as MAXIMUM_BANDS,
    PAPER_TYPES as PAPER_TYPES,
    UNKNOWN_TYPE as UNKNOWN_TYPE,
    Choice as Choice,
    SpoolConfig as SpoolConfig,
    WorkLimits as WorkLimits,
)
from opir_core.scene.target_classes import (
    core_plumes as core_plumes,
    core_target_class as core_target_class,
    core_target_classes as core_target_classes,
    plume_table as plume_table,
)
