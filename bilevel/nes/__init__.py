"""Natural evolution strategies over synthetic environments, as ask and tell."""

from bilevel.nes.algorithm import NES, AgentSampler
from bilevel.nes.fitness import fitness, worth_of
from bilevel.nes.start import Psi
from bilevel.nes.state import GenerationRecord, NESState

__all__ = ["NES", "AgentSampler", "GenerationRecord", "NESState", "Psi", "fitness", "worth_of"]
