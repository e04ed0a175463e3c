"""The result: layers over the grid with their units and definitions, as xarray, NetCDF and
Parquet.
"""

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
    """Values over the grid: `dims` are those before latitude and longitude; nan where there is
    none.
    """

    name: str
    title: str
    unit: str
    dims: tuple[str, ...]
    values: NDArray[Any]
    definition: str


@frozen(eq=False)
class CoverageMap:
    """Layers over a grid, the coordinates of their dimensions, and what they are of."""

    grid: PlaceGrid
    coordinates: Mapping[str, Sequence[float] | Sequence[str]]
    layers: Sequence[Layer]
    attributes: Mapping[str, str]

    def __getitem__(self, name: str) -> Layer:
        """Return a layer by name; raises `KeyError` with all names."""
        for layer in self.layers:
            if layer.name == name:
                return layer
        raise KeyError(f"{name!r} is not one of {', '.join(each.name for each in self.layers)}")

    def over_cells(self, layer: Layer) -> FloatArray:
        """Return a layer's values (…, cells) as floats, one row for each combination of its
        dimensions.
        """
        return np.asarray(layer.values, dtype=np.float64).reshape(-1, len(self.grid.weights()))

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
            for name, values in {**self.coordinates, **_places(self.grid)}.items()
        }
        variables = {
            each.name: (
                (*each.dims, *PLACES),
                each.values,
                {"long_name": each.title, "units": each.unit, "comment": each.definition},
            )
            for each in self.layers
        }
        return xarray.decode_cf(xarray.Dataset(variables, coordinates, dict(self.attributes)))

    def write_netcdf(self, path: Path) -> None:
        """Write NetCDF 3 (64-bit offset) with the attributes of the CF conventions."""
        from scipy.io import netcdf_file

        with netcdf_file(path, "w", version=2) as file:
            file.Conventions = "CF-1.8"
            for name, words in self.attributes.items():
                setattr(file, name, words.encode())
            for name, values in {**self.coordinates, **_places(self.grid)}.items():
                _write_coordinate(file, name, values, self.coordinate_attributes(name))
            for each in self.layers:
                values = _storable(each.values)
                variable = file.createVariable(each.name, values.dtype, (*each.dims, *PLACES))
                variable[:] = values
                missing = (
                    {"_FillValue": values.dtype.type(np.nan)} if values.dtype.kind == "f" else {}
                )
                texts = {"long_name": each.title, "comment": each.definition, "units": each.unit}
                for key, value in {
                    **{key: text.encode() for key, text in texts.items()},
                    **missing,
                }.items():
                    setattr(variable, key, value)

    def write_parquet(self, path: Path) -> None:
        """Write one row for each cell and combination of dimensions of the layers that have the
        most of them.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        sizes = {name: len(values) for name, values in self.coordinates.items()}
        still = [each for each in self.layers if "time" not in each.dims]
        names = [name for name in sizes if any(name in each.dims for each in still)]
        shape = tuple(sizes[name] for name in names)
        columns: dict[str, Any] = {}
        whole = (*shape, *self.grid.shape)
        for axis, name in enumerate(names):
            own = np.array(self.coordinates[name]).reshape(
                [-1 if each == axis else 1 for each in range(len(whole))]
            )
            columns[name] = np.broadcast_to(own, whole).ravel()
        columns["latitude"] = np.broadcast_to(self.grid.latitude_deg[:, None], whole).ravel()
        columns["longitude"] = np.broadcast_to(self.grid.longitude_deg, whole).ravel()
        for each in still:
            own_shape = [sizes[name] if name in each.dims else 1 for name in names]
            values = _storable(each.values).reshape(*own_shape, *self.grid.shape)
            columns[each.name] = np.broadcast_to(values, whole).ravel()
        texts = {f"opir_{name}": words for name, words in self.attributes.items()}
        described = {each.name: {"units": each.unit, "long_name": each.title} for each in still}
        described |= {
            name: self.coordinate_attributes(name) for name in columns if name not in described
        }
        fields = [
            pa.field(name, pa.array(own[:0]).type, metadata=described[name])
            for name, own in columns.items()
        ]
        table = pa.table(columns, schema=pa.schema(fields, metadata=texts))
        pq.write_table(table, path, compression="zstd")


def _places(grid: PlaceGrid) -> dict[str, FloatArray]:
    return {"latitude": grid.latitude_deg, "longitude": grid.longitude_deg}


def _write_coordinate(file: Any, name: str, values: Any, attributes: Mapping[str, str]) -> None:
    own = np.asarray(values)
    file.createDimension(name, len(own))
    if own.dtype.kind == "U":
        # NetCDF 3 has no text along a dimension but characters: the names are an attribute too.
        width = max(len(text.encode()) for text in own.tolist())
        file.createDimension(f"{name}_letters", width)
        variable = file.createVariable(name, "c", (name, f"{name}_letters"))
        variable[:] = np.array(
            [list(text.encode().ljust(width)) for text in own.tolist()], dtype=np.uint8
        ).view("S1")
        variable.long_name = attributes["long_name"].encode()
        return
    variable = file.createVariable(name, "f8", (name,))
    variable[:] = own
    for key, words in attributes.items():
        setattr(variable, key, words.encode())


def _storable(values: NDArray[Any]) -> NDArray[Any]:
    """Return values in a number type of NetCDF 3: counts in 16 bits, all else in 32."""
    if values.dtype.kind in "bui":
        return values.astype(np.int16)
    return values.astype(np.float32)
