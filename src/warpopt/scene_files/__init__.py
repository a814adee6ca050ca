"""Scenes from files and formulas, using NumPy only: depth images, glTF, a landscape, and a rasteriser."""
