from opir_core.interfaces.directors import (
    SensorTask as SensorTask,
)
from opir_core.live.changes import (
    BusyError as BusyError,
    RefusedError as RefusedError,
    RestartError as RestartError,
)
from opir_core.live.loops import (
    limit_pauses as limit_pauses,
)
from opir_core.live.progress import (
    Progress as Progress,
)
from opir_core.live.recording import (
    ChangesFile as ChangesFile,
    recorded_run as recorded_run,
    repeated_run as repeated_run,
)
from opir_core.live.running import (
    LiveRun as LiveRun,
    LiveSettings as LiveSettings,
    LiveWindow as LiveWindow,
)
from opir_core.live.status import (
    LATE_EDGES_S as LATE_EDGES_S,
    LiveStatus as LiveStatus,
    SensorStatus as SensorStatus,
)
from opir_core.reading.format_versions import (
    is_recorded as is_recorded,
)
