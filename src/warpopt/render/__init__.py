"""Matrices for rendering."""
