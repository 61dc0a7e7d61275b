"""Reduces attacks: the smallest share that makes a planner fail, a harmless neighbour, the smallest case."""
