"""Searches with the gradient of the mirror: their cost, rules, limits and loops."""
