"""The commands, one file for each command or family: options in, calls of the package, tables out."""
