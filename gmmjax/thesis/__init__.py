"""The reproduction of Jamie Santos's thesis: `laboratory` simulates, `chapter4` evaluates, `report` writes the results.

Nothing but the command line imports this package; it may import any other.
"""
