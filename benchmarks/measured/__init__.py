"""What the pages of results and performance are made of: `make results` measures, and writes their tables."""
