"""What the operating system does for us: files replaced at once, locks, signals, processes."""
