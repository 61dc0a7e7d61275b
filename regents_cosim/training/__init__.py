"""What to fine-tune a planner on, how much of it to keep, and what that changed."""
