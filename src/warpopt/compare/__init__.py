"""Comparison of rules for lambda with the optimum and the lower bound."""
