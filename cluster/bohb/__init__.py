"""BOHB (Falkner et al., 2018): hpbandster's brackets and model, and what a study is made of.

The search itself knows nothing of Ray, and can be run in one process; `tune` runs it on Ray Tune.
"""
