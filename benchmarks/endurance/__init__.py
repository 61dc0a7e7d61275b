"""Harnesses that try to break the chain for long: kills, writers side by side, mutated files, endless runs.

Each is a program of its own (`python -m benchmarks.endurance.kills --count 1000`) that prints one JSON line
per subject, and has a short form of seconds among the slow tests.
"""
