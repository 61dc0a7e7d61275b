"""Texts in pictures and around them."""
