"""Layers over the grid with units and definitions, as xarray, NetCDF and Parquet."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import FloatArray
from opir_coverage.grid import PlaceGrid

if TYPE_CHECKING:
    import xarray

#: The last dimensions of every layer.
PLACES = ("latitude", "longitude")
#: The dimensions before them, in order, with their units and meanings.
DIMENSIONS: Mapping[str, tuple[str, str]] = {
    "band": ("", "spectral band"),
    "assets": ("1", "least number of sensors in view for a point to be covered"),
    "height": ("km", "height of the target above WGS 84"),
    "azimuth": ("degree", "launch azimuth, clockwise from north"),
    "launch_time": ("s", "launch"),
    "time": ("s", "middle of the step"),
}
#: Dimensions that are seconds from the scene's epoch.
_TIMES = ("launch_time", "time")
#: Units of places, in the words of the CF conventions.
_PLACE_UNITS = {"latitude": "degrees_north", "longitude": "degrees_east"}


@frozen(eq=False)
class Layer:
    """Values over the grid, nan where unknown; `dims` are those before latitude and longitude."""

    name: str
    title: str
    unit: str
    dims: tuple[str, ...]
    values: NDArray[Any]
    definition: str


@frozen(eq=False)
class CoverageMap:
    """Layers over a grid, the coordinates of their dimensions, and attributes of the scene."""

    grid: PlaceGrid
    coordinates: Mapping[str, Sequence[float] | Sequence[str]]
    layers: Sequence[Layer]
    attributes: Mapping[str, str]

    def __getitem__(self, name: str) -> Layer:
        """Return a layer by name; raises `KeyError` with all names."""
        for layer in self.layers:
            if layer.name == name:
                return layer
        raise KeyError(
            f"{name!r} is not one of {', '.join(candidate.name for candidate in self.layers)}"
        )

    def over_cells(self, layer: Layer) -> FloatArray:
        """Return a layer's values (combinations of its dimensions, cells) as floats."""
        return np.asarray(layer.values, dtype=np.float64).reshape(-1, len(self.grid.weights()))

    def _all_coordinates(self) -> dict[str, Any]:
        places = (self.grid.latitude_deg, self.grid.longitude_deg)
        return {**self.coordinates, **dict(zip(PLACES, places, strict=True))}

    def coordinate_attributes(self, name: str) -> dict[str, str]:
        """Return the attributes of a coordinate, those of the CF conventions."""
        if name in _PLACE_UNITS:
            return {"units": _PLACE_UNITS[name], "standard_name": name, "long_name": name}
        unit, meaning = DIMENSIONS[name]
        if name in _TIMES:
            since = self.attributes["epoch"].replace("T", " ").removesuffix("Z")
            return {"units": f"seconds since {since}", "calendar": "standard", "long_name": meaning}
        return {"long_name": meaning, **({"units": unit} if unit else {})}

    def xarray(self) -> "xarray.Dataset":
        """Return an `xarray.Dataset`, times as dates; raises `ImportError` without xarray."""
        import xarray

        coordinates = {
            name: (name, list(values), self.coordinate_attributes(name))
            for name, values in self._all_coordinates().items()
        }
        variables = {
            layer.name: (
                (*layer.dims, *PLACES),
                layer.values,
                {"long_name": layer.title, "units": layer.unit, "comment": layer.definition},
            )
            for layer in self.layers
        }
        return xarray.decode_cf(xarray.Dataset(variables, coordinates, dict(self.attributes)))

    def write_netcdf(self, path: Path) -> None:
        """Write NetCDF 3 (64-bit offset) with the attributes of the CF conventions."""
        from scipy.io import netcdf_file

        with netcdf_file(path, "w", version=2) as file:
            file.Conventions = "CF-1.8"
            for name, words in self.attributes.items():
                setattr(file, name, words.encode())
            for name, values in self._all_coordinates().items():
                _write_coordinate(file, name, values, self.coordinate_attributes(name))
            for layer in self.layers:
                _write_layer(file, layer)

    def write_parquet(self, path: Path) -> None:
        """Write a row for each cell and combination of the dimensions of layers, but times."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        columns = self._columns()
        fields = [
            pa.field(name, pa.array(column[:0]).type, metadata=self._column_attributes(name))
            for name, column in columns.items()
        ]
        texts = {f"opir_{name}": words for name, words in self.attributes.items()}
        table = pa.table(columns, schema=pa.schema(fields, metadata=texts))
        pq.write_table(table, path, compression="zstd")

    def _columns(self) -> dict[str, NDArray[Any]]:
        """Return coordinates and layers without times, one value per cell and combination."""
        layers = [layer for layer in self.layers if "time" not in layer.dims]
        names = [name for name in self.coordinates if any(name in layer.dims for layer in layers)]
        dims = (*names, *PLACES)
        coordinates = self._all_coordinates()
        shape = tuple(len(coordinates[name]) for name in dims)

        def column(values: Any, value_dims: Sequence[str]) -> NDArray[Any]:
            sizes = [len(coordinates[name]) if name in value_dims else 1 for name in dims]
            return np.broadcast_to(np.reshape(values, sizes), shape).ravel()

        columns = {name: column(coordinates[name], (name,)) for name in dims}
        return columns | {
            layer.name: column(_storable(layer.values), (*layer.dims, *PLACES)) for layer in layers
        }

    def _column_attributes(self, name: str) -> dict[str, str]:
        layers = {layer.name: layer for layer in self.layers}
        if name in layers:
            return {"units": layers[name].unit, "long_name": layers[name].title}
        return self.coordinate_attributes(name)


def _write_coordinate(file: Any, name: str, values: Any, attributes: Mapping[str, str]) -> None:
    column = np.asarray(values)
    file.createDimension(name, len(column))
    if column.dtype.kind == "U":
        variable = _text_variable(file, name, [text.encode() for text in column.tolist()])
        variable.long_name = attributes["long_name"].encode()
        return
    variable = file.createVariable(name, "f8", (name,))
    variable[:] = column
    for key, words in attributes.items():
        setattr(variable, key, words.encode())


def _text_variable(file: Any, name: str, texts: Sequence[bytes]) -> Any:
    """Return a new variable of texts: NetCDF 3 has characters along a dimension of their own."""
    width = max(map(len, texts))
    file.createDimension(f"{name}_letters", width)
    variable = file.createVariable(name, "c", (name, f"{name}_letters"))
    letters = [list(text.ljust(width)) for text in texts]
    variable[:] = np.array(letters, dtype=np.uint8).view("S1")
    return variable


def _write_layer(file: Any, layer: Layer) -> None:
    values = _storable(layer.values)
    variable = file.createVariable(layer.name, values.dtype, (*layer.dims, *PLACES))
    variable[:] = values
    texts = {"long_name": layer.title, "comment": layer.definition, "units": layer.unit}
    attributes: dict[str, Any] = {key: words.encode() for key, words in texts.items()}
    if values.dtype.kind == "f":
        attributes["_FillValue"] = values.dtype.type(np.nan)
    for key, value in attributes.items():
        setattr(variable, key, value)


def _storable(values: NDArray[Any]) -> NDArray[Any]:
    """Return values in a number type of NetCDF 3: counts in 16 bits, all else in 32."""
    if values.dtype.kind in "bui":
        return values.astype(np.int16)
    return values.astype(np.float32)
