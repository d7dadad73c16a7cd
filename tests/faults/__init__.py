"""Faults injected into real studies, and what came of them.

A study is run once undisturbed. Then it is run again and again, and killed, cut off or
starved meanwhile; in the end its journal, checkpoints and best SE are compared with those
of the first, and MLflow with the disk.
"""
