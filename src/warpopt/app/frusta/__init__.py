"""Optima and rules over view frusta and directions, block by block; shared by `run`, `solve`, `rules` and `limit`."""
