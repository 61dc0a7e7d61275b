"""Planners of other packages, each run by the interpreter of an environment that has its package (`python:`)."""
