"""BOHB (Falkner et al., 2018): hpbandster's brackets and model under Ray Tune."""

from cluster.bohb.brackets import Rung, bracket_table, budget_ladder
from cluster.bohb.journal import Journal
from cluster.bohb.search import BracketSearch, Job

__all__ = ["BracketSearch", "Job", "Journal", "Rung", "bracket_table", "budget_ladder"]
