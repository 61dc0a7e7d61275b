"""Compare methods and planners over many windows: the commands `bench table1`, `bench transfer` and `bench cross`."""
