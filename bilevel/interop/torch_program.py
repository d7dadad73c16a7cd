"""SEs as programs of `torch.export`, which torch loads without this package."""

import torch
from torch.export import Dim, ExportedProgram, export

from bilevel.synthetic_env import StoredSE
from bilevel.synthetic_env.torch_module import SEModule


def torch_program(se: StoredSE) -> ExportedProgram:
    """The SE as a program from states (n, S) float32 and actions (n,) int64, for any n of at least
    2, to next states (n, S), rewards (n,) and done (n,); an episode ends at done > 0.5."""
    rows = {0: Dim("n", min=2)}
    example = (torch.zeros(2, se.architecture.state_size), torch.zeros(2, dtype=torch.int64))
    return export(SEModule(se), example, dynamic_shapes={"state": rows, "action": rows})
