"""The faults of `tests.faults`, injected many times: the table of docs/reliability.md."""
