"""Receivers by their depth along Z_w, which lower bounds are made of."""
