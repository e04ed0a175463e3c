from opir_core.interfaces.records import (
    binary_body as binary_body,
    framed_messages as framed_messages,
)
from opir_core.output.delivery import (
    RunOutcome as RunOutcome,
    deliver as deliver,
    opened_sink as opened_sink,
)
from opir_core.output.events import (
    SCHEMA_VERSION as SCHEMA_VERSION,
    TRACKS_VERSION as TRACKS_VERSION,
    detection_schema as detection_schema,
    schema as schema,
)
from opir_core.output.events.encoder_input import (
    event_counter as event_counter,
    only_encodable as only_encodable,
    require_valid as require_valid,
)
from opir_core.output.events.estimates import (
    burnout_texts as burnout_texts,
    impact_texts as impact_texts,
    launch_texts as launch_texts,
    state_texts as state_texts,
    time_texts as time_texts,
)
from opir_core.output.events.forge import (
    ForgeEncoder as ForgeEncoder,
)
from opir_core.output.events.rendering import (
    Column as Column,
    Decimal as Decimal,
    Ids as Ids,
    Looked as Looked,
    Times as Times,
    chosen_renderer as chosen_renderer,
    event_times as event_times,
    reference as reference,
)
from opir_core.output.events.text import (
    DEGREE_DECIMALS as DEGREE_DECIMALS,
    METRE_DECIMALS as METRE_DECIMALS,
    POINT_DECIMALS as POINT_DECIMALS,
    RATIO_DECIMALS as RATIO_DECIMALS,
    SHARE_DECIMALS as SHARE_DECIMALS,
    SNR_DECIMALS as SNR_DECIMALS,
    number_texts as number_texts,
    propagated_positions as propagated_positions,
    rounded as rounded,
    rounded_bearing_deg as rounded_bearing_deg,
    rounded_degrees as rounded_degrees,
    rounded_longitude_deg as rounded_longitude_deg,
    rounded_number as rounded_number,
    timestamp_text as timestamp_text,
    unix_microseconds as unix_microseconds,
    vector_texts as vector_texts,
    writable_unix_microseconds as writable_unix_microseconds,
)
from opir_core.output.geojson import (
    DECIMALS as DECIMALS,
    geometry_of as geometry_of,
    region_figures as region_figures,
    region_texts as region_texts,
)
from opir_core.output.heartbeats import (
    Heartbeats as Heartbeats,
    heartbeat_schema as heartbeat_schema,
)
from opir_core.output.pump import (
    SinkReport as SinkReport,
)
from opir_core.output.run_files import (
    CommandsFile as CommandsFile,
    TruthFile as TruthFile,
)
from opir_core.output.saved_runs import (
    read_run as read_run,
)
from opir_core.output.sink_thread import (
    WITHOUT_SPOOL as WITHOUT_SPOOL,
    SinkStatus as SinkStatus,
)
from opir_core.output.spool.salvage import (
    Salvage as Salvage,
    SpoolState as SpoolState,
    salvage as salvage,
    spool_state as spool_state,
)
from opir_core.output.temporary_files import (
    file_digest as file_digest,
)
from opir_core.output.tracks_file import (
    TracksFile as TracksFile,
    read_tracks as read_tracks,
)
from opir_core.output.transaction import (
    FILES_KEY as FILES_KEY,
    OutputFiles as OutputFiles,
    finish_interrupted as finish_interrupted,
)
