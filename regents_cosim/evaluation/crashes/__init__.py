"""What a crash says about the planner, how real it is, and how a method fares by such measures."""
