"""Rules for lambda beside the optimum and the limit."""
