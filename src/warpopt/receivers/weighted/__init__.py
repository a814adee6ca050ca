"""Receivers that are a set: what each counts for, and their samples for means that have no moments."""
