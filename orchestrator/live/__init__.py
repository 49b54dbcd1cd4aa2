"""Watch a run in a viewer while it lasts, and steer it from there."""
