"""The diagnosis engine: a record, a system, windows, one fit, one search and one verdict."""
