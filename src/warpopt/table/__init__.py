"""Tables of the optimal warp with a promised accuracy: the table, its lookup and its file."""
