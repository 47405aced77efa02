"""Stage: what was found becomes objects, with kind, probability, significance and motion."""
