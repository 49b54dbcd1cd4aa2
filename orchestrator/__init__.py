"""Couple components by co-simulation, on exact time, and record every signal."""
