"""BOHB (Falkner et al., 2018): hpbandster's brackets and model under Ray Tune.

Nothing is imported here: trials are processes of their own that need no hpbandster.
"""
