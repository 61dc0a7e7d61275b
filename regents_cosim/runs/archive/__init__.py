"""The map of behaviours of a suite: which kinds of crash it holds, and the best crash of each kind."""
