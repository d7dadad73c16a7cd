"""The paper's experiments, figure by figure, and a report that sets them beside the authors'.

Each experiment is one run of the kind `experiment`: it makes the SEs that it needs by ordinary NES
runs, trains fresh agents on them, and draws what came out. `figures` has one file for each;
docs/experiments.md tells what each one shows.
"""
