"""Whether the ego could have avoided a crash: its manoeuvres, and proofs that there is none."""
