"""Scenes from files and formulas, in NumPy alone: depth images, glTF, a landscape, and the rasteriser between them."""
