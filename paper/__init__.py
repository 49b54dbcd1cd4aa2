"""The seed paper, re-run: its figures and claims on our plant, against true optima."""
