"""What no map can better."""
