"""Who works: processes of this machine, or a Dask cluster (`docs/cluster.md`)."""
