"""Receivers by depth along Z_w, used by lower bounds."""
