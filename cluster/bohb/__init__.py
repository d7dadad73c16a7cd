"""BOHB (Falkner et al., 2018) over NES runs: studies of a task's hyperparameters.

`study` defines a search and stores its journal. `search` has hpbandster's brackets and model, and
the NES runs. `results` has tables and pictures. These three run in one process, without Ray. `tune`
runs a search on Ray Tune.
"""
