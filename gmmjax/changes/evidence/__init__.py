"""Evidence stage: candidates are changes only where the other survey observed their places."""
