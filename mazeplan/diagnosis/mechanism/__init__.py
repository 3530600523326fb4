"""The diagnosis of other systems with one degree of freedom."""
