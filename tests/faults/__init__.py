"""Fault injection into real studies.

A study runs once undisturbed, as the reference. It then runs again while processes are killed,
files damaged or services stopped. At the end its journal, checkpoints and best SE are compared with
the reference, and MLflow with the disk.
"""
