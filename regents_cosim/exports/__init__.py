"""Cases in the formats of other tools."""
