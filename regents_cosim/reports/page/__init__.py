"""The page of a suite: its data, and the script and style that show them."""
