"""Cases in highway-env again: replayed, as an environment for agents, and put into others."""
