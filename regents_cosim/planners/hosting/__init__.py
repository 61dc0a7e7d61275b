"""Planners outside the compiled loop: in their own process, behind a prefix, from torch, as objects."""
