"""Makes the tables of the pages of results and performance (`make results`)."""
