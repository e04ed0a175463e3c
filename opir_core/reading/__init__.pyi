from opir_core.reading.canonical import (
    scene_hash as scene_hash,
    scene_mapping as scene_mapping,
)
from opir_core.reading.component_reader import (
    ComponentReader as ComponentReader,
    Settings as Settings,
)
from opir_core.reading.examples import (
    example as example,
)
from opir_core.reading.format_versions import (
    EVENT_FORMAT as EVENT_FORMAT,
    HEARTBEAT_FORMAT as HEARTBEAT_FORMAT,
    STUDY_FORMAT as STUDY_FORMAT,
    Format as Format,
)
from opir_core.reading.loading import (
    load_scene as load_scene,
    overridden as overridden,
    placed as placed,
    scene_from_mapping as scene_from_mapping,
)
from opir_core.reading.nodes import (
    InvalidNode as InvalidNode,
    Node as Node,
    SwitchWord as SwitchWord,
    complaints_inside as complaints_inside,
    ordered as ordered,
)
from opir_core.reading.plain_data import (
    data_of_node as data_of_node,
    is_quantity as is_quantity,
    node_of_data as node_of_data,
    number_in as number_in,
)
from opir_core.reading.scene_schema import (
    epoch_us_of_text as epoch_us_of_text,
)
from opir_core.reading.strict_yaml import (
    node_of_scalar as node_of_scalar,
    node_of_yaml as node_of_yaml,
)
from opir_core.reading.structuring import (
    UnreadableTypeError as UnreadableTypeError,
    block_of as block_of,
    class_reader as class_reader,
)
from opir_core.reading.targets import (
    ID_RULE as ID_RULE,
)
