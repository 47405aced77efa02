"""Scores against truth, and the tables made of them."""
