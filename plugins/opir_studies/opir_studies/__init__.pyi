from opir_studies.comparison import (
    Comparison as Comparison,
    compared as compared,
)
from opir_studies.executors import (
    LostTasksError as LostTasksError,
)
from opir_studies.optimising import (
    Optimised as Optimised,
    optimise as optimise,
)
from opir_studies.rerunning import (
    Rerun as Rerun,
    rerun as rerun,
)
from opir_studies.result import (
    StudyResult as StudyResult,
    load_study as load_study,
)
from opir_studies.sharding import (
    merged as merged,
    sweep_shard as sweep_shard,
)
from opir_studies.study import (
    Study as Study,
    read_study as read_study,
)
from opir_studies.sweeping import (
    Shard as Shard,
    StudyError as StudyError,
    StudyProgress as StudyProgress,
    sweep as sweep,
)
from opir_studies.tuning import (
    Tuned as Tuned,
    tune as tune,
)
