from opir_core.sensors.confusion_matrix import (
    confusion_complaint as confusion_complaint,
    is_probability as is_probability,
)
from opir_core.sensors.scan_patterns import (
    AlignedScan as AlignedScan,
)
