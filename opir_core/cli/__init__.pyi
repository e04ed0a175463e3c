from opir_core.cli.answer_lines import (
    answers as answers,
    reported_tables as reported_tables,
    source_table as source_table,
    track_table as track_table,
)
from opir_core.cli.components import (
    OwnedComponent as OwnedComponent,
    add_component as add_component,
    components_named as components_named,
)
from opir_core.cli.main import (
    THREADS as THREADS,
)
from opir_core.cli.scene_arguments import (
    add_dead_after as add_dead_after,
    add_overrides as add_overrides,
    add_scene_arguments as add_scene_arguments,
    scene_of as scene_of,
)
from opir_core.cli.terminal import (
    ending_signals as ending_signals,
    grouped as grouped,
    prints_on_standard_error as prints_on_standard_error,
    probability_text as probability_text,
    table as table,
)
