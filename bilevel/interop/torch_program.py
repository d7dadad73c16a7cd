"""SEs as `torch.export` programs, which torch loads without this package."""

import torch
from torch.export import Dim, ExportedProgram, export

from bilevel.synthetic_env import StoredSE
from bilevel.synthetic_env.torch_module import SEModule


def torch_program(se: StoredSE) -> ExportedProgram:
    """Export an SE as a program with the inputs and outputs of `SEModule.forward`, for batches of
    at least 2 states (n, S) and actions (n,)."""
    rows = {0: Dim("n", min=2)}
    example = (torch.zeros(2, se.architecture.state_size), torch.zeros(2, dtype=torch.int64))
    return export(SEModule(se), example, dynamic_shapes={"state": rows, "action": rows})
