"""Searches without a gradient: CMA-ES, random search, and searches for diverse crashes."""
