"""The executor `dask`: the runs of a study on a Dask cluster, or on workers of this computer."""
