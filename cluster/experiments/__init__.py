"""The paper's experiments, and a report that compares their results with the authors'.

Each experiment is a run of the kind `experiment`: it learns the SEs that it needs by ordinary NES
runs, trains fresh agents on them, and writes data, pictures and a summary. Each has one file in
`figures` and one line in `registry`; docs/experiments.md describes them.
"""
