from opir_export.search_volumes import (
    search_volumes as search_volumes,
)
from opir_export.tabular.run_tables import (
    tables as tables,
    to_pandas as to_pandas,
    to_polars as to_polars,
)
