"""Files and folders that are written whole or not at all, with locks between processes."""
