"""Ray Tune for a study: it places trials and restarts nothing; all state is the study's own.

Nothing is imported here: trials are processes of their own that need no hpbandster.
"""
