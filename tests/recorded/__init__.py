"""What the library answered once, so that a change of its code can be told from a change of its answers."""
