"""Campaigns: many runs in this process, in other processes, or on other machines (Dask). Each is stored as it ends.

    Campaign --executor--> run, somewhere --store--> one line a run

Each run has its own seed and builds everything anew. So its result does not depend on the machine, on the time, or on
other runs. Only dask_cluster.py imports `dask` and `distributed`, and only executor.py `joblib`, when they are used.
"""
