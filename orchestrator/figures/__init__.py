"""The figures of a flight, from a trace in memory or from a recording."""
