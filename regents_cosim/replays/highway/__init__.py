"""Replays cases in highway-env: as a replay, as an environment for agents, and injected into other environments."""
