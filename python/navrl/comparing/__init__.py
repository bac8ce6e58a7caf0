"""A comparison: who takes part, under which conditions, what is kept of it, and how it is shown."""
