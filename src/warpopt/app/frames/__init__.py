"""`warpopt frames`: renders frames with each warp's shadows, and measures what is wrong in them."""
