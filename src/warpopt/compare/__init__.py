"""Rules for lambda beside the optimum and the lower bound."""
