"""Campaigns: many runs, in this process, in others, or on other machines (Dask). Each is stored as it ends.

Each has its own seed and builds everything anew, so its result depends neither on the machine nor on other runs.
"""
