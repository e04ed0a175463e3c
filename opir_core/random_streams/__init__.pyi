from opir_core.random_streams.detection_ids import (
    id_key as id_key,
    uuid8_words as uuid8_words,
    uuid_characters as uuid_characters,
    uuid_text as uuid_text,
)
from opir_core.random_streams.pair_streams import (
    PairStreams as PairStreams,
    WindowNumbers as WindowNumbers,
)
from opir_core.random_streams.philox import (
    SCHEME as SCHEME,
    Stream as Stream,
    further_words as further_words,
    normal_pairs as normal_pairs,
    stream_key as stream_key,
    uniforms_of as uniforms_of,
)
