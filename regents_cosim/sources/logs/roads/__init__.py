"""The roads of logs: maps in other formats, and areas drawn from them."""
