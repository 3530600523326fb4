"""Many runs, wherever they are done: in this process, in others, or on other machines (Dask); kept as they end.

    Campaign --parcel--> names and contents of files --executor--> run_one, somewhere --store--> one row a run

Each run has a seed of its own and is done from nothing, so that its result is the same wherever, whenever and beside
whatever it is done. `dask` and `distributed` are imported in dask_cluster.py alone, `pyarrow` in store.py alone, both
only when they are used.
"""
