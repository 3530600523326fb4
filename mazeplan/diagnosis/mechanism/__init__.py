"""The diagnosis of anything else with one degree of freedom."""
