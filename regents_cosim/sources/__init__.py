"""The outside world becomes Scenarios: simulators and logs. A source knows nothing of attacks."""
