"""The run: initialisation, the loop over ticks, policies and events."""
