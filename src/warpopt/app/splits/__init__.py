"""Ways of splitting a view, beside the best: for `warpopt cascades` and `warpopt compare`."""
