"""From the records of a scenario to a system that can run: components, ports, links, schedule."""
