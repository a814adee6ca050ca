"""Optima and rules over view frusta and directions, block by block: what `run`, `solve`, `rules` and `limit` share."""
