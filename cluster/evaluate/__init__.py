"""Evaluations of SEs: command, report and view."""
