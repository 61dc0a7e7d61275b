"""Cases and suites on disk."""
