"""Readers under mutations of valid files: each ends in a result or an `InputError` of one line, within limits.

`python -m tests.fuzzing --mutations 20000` tries more of them than the tests do; docs/contributing.md says how.
"""
