"""A component in a process of its own, which may crash, exit or hang without harm to the run."""
