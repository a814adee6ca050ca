"""Matrices to render with."""
