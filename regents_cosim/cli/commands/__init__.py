"""One command, or one family of them, a file: options in, calls of the package, tables out."""
