"""Receivers that fill a body or a plane, and their integrals."""
