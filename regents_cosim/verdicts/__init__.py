"""Verdicts on a crash: is it clean, who broke the law, who could have avoided it, and whose fault it was."""
