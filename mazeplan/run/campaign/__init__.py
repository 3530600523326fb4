"""Campaigns: many runs in this process, in other processes, or on other machines (Dask). Each is stored as it ends.

    Campaign --parcel--> names and contents of files --executor--> run_one, somewhere --store--> one row a run

Each run has its own seed and builds everything anew. So its result does not depend on the machine, on the time, or on
other runs. Only dask_cluster.py imports `dask` and `distributed`, only store.py imports `pyarrow`, and only when they
are used.
"""
