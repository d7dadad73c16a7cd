"""Natural evolution strategies (NES) over synthetic environments, as ask and tell."""

from bilevel.nes.algorithm import NES
from bilevel.nes.learning import learn
from bilevel.nes.records import Finalist, GenerationRecord
from bilevel.nes.state import NESState

__all__ = ["NES", "Finalist", "GenerationRecord", "NESState", "learn"]
