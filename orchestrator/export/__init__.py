"""Components as FMUs: FMI 2.0 and 3.0 for co-simulation."""
