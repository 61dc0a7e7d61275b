"""Runs that can be stopped and continued: the work done in a folder, the code that did it, and shards of a run."""
