"""Drives with which searches begin: lawful lines, speeds along them, and the times at which they meet the ego."""
