"""The faults of `tests.faults`, all of them, many times: the table of docs/reliability.md."""
