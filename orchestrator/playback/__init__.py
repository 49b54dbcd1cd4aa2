"""A recording as a component, and a recorded flight flown again."""
