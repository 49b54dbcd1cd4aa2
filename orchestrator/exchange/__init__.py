"""System Structure and Parameterization (SSP 1.0): a scenario out, a system structure in."""
