"""Stage: candidates that the evidence left become changes, with kind, probability, significance and transform."""
