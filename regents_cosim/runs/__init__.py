"""Everything that the command line does with folders, from Python: record, attack, continue, split, merge, grow."""
