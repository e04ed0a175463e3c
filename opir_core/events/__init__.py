"""The detection event: its identifiers, its timestamps, its schema and its encoders.

The encoders are in modules of their own, which are imported when a scene chooses one.
"""

from opir_core.events.schema import SCHEMA_VERSION, detection_schema, detection_schema_text

__all__ = ["SCHEMA_VERSION", "detection_schema", "detection_schema_text"]
