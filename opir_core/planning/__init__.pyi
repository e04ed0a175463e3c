from opir_core.planning.looks import (
    Looks as Looks,
    blocks as blocks,
    look_times_s as look_times_s,
)
from opir_core.planning.pair_compiler import (
    PairCompiler as PairCompiler,
)
from opir_core.planning.partial_looks import (
    ModeSpan as ModeSpan,
    mode_spans as mode_spans,
)
from opir_core.planning.plan import (
    drawn_bias as drawn_bias,
    whole_flights as whole_flights,
)
from opir_core.planning.solar_exclusion import (
    solar_exclusions as solar_exclusions,
)
from opir_core.planning.sources import (
    distinct_bands as distinct_bands,
    scene_atmosphere as scene_atmosphere,
)
from opir_core.planning.targets import (
    Targets as Targets,
    join_targets as join_targets,
)
from opir_core.planning.visibility import (
    visible_now as visible_now,
)
