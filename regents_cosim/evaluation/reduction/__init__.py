"""An attack with less in it: the least that makes a planner fail, a harmless neighbour, the smallest case."""
