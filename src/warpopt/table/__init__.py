"""Tables of the optimal warp with a promised accuracy."""
