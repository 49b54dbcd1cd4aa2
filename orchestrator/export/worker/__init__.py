"""The Python inside an exported FMU, in its resources; imports nothing of Hedgehop but itself."""
