"""One traffic scene over a horizon, which all stages exchange, with the record of its attack and its verdicts."""
