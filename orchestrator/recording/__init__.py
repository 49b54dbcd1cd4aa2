"""Recordings: MCAP out and in, well-known messages for viewers, comparison."""
