"""The careful driver of UN R157 as a planner."""
