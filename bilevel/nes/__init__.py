"""Natural evolution strategies (NES) over synthetic environments, as ask and tell."""

from bilevel.nes.algorithm import NES
from bilevel.nes.learning import learn
from bilevel.nes.records import GenerationRecord
from bilevel.nes.state import Finalist, NESState

__all__ = ["NES", "Finalist", "GenerationRecord", "NESState", "learn"]
