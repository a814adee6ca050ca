"""Lower bounds for any map."""
