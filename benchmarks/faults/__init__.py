"""Fault injection into real studies.

A study runs once undisturbed. Then it runs repeatedly with faults; at the end its journal,
checkpoints and best SE are compared with the first study's, and MLflow with the disk. `python -m
benchmarks.faults` measures the table of docs/reliability.md.
"""
