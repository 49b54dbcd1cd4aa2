"""A scenario: YAML, positions and validation, down to frozen records."""
