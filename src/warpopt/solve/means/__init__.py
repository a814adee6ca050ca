"""Means of a texel's size over weighted receivers, which may have several local minima in eta."""
