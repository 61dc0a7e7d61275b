"""Runs that are stopped and go on: what is done in a folder, by whose code, and which share of it is whose."""
