"""FMUs as components: FMI 2.0 and 3.0 co-simulation, FMI 3.0 scheduled execution."""
