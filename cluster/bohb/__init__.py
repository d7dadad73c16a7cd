"""BOHB (Falkner et al., 2018): a study of a task's hyperparameters, and what becomes of it.

`study` says what is searched and keeps what was found, `search` is hpbandster's brackets and model
with the NES runs that they ask for, `results` is what is drawn and told of them. None of these
knows Ray: a search can be run in one process. `tune` runs it on Ray Tune.
"""
