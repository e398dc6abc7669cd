"""Many runs from one file: planned, run on Dask, each kept in a file of its own, and compared in tables."""
