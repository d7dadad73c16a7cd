"""An SE as a `torch.nn.Module`."""

import torch
from torch import Tensor, nn

from bilevel.synthetic_env.architecture import NETWORKS, Architecture
from bilevel.synthetic_env.storage import StoredSE
from bilevel.torch_activations import activation_module


class SEModule(nn.Module):
    """Three MLPs on concat(action, state), with the parameters of an SE.

    Outputs are differentiable with respect to the states. Parameters are frozen; call
    `requires_grad_(True)` to train them.
    """

    def __init__(self, se: StoredSE) -> None:
        super().__init__()
        self.architecture: Architecture = se.architecture
        tensors = se.architecture.tensors(se.psi)
        for name in NETWORKS:
            layers: list[nn.Module] = []
            for layer in range(se.architecture.hidden_layers + 1):
                weight = torch.tensor(tensors[f"{name}.{layer}.weight"])
                linear = nn.Linear(weight.shape[1], weight.shape[0])
                linear.weight.data = weight
                linear.bias.data = torch.tensor(tensors[f"{name}.{layer}.bias"])
                layers += [linear, activation_module(se.architecture.activation)]
            self.add_module(name, nn.Sequential(*layers[:-1]))
        self.requires_grad_(False)

    def forward(self, state: Tensor, action: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return next states (..., S), rewards (...,) and raw done outputs (...,).

        States are (..., S) float32. Actions are (...,) int64, which become one-hot, or (..., A)
        float32 in [-1, 1]. An episode ends at done > 0.5.
        """
        if not self.architecture.continuous:
            action = nn.functional.one_hot(action, self.architecture.action_size)
        inputs = torch.cat([action.to(state.dtype), state], dim=-1)
        outputs = [self.get_submodule(name)(inputs) for name in NETWORKS]
        return outputs[0], outputs[1].squeeze(-1), outputs[2].squeeze(-1)
