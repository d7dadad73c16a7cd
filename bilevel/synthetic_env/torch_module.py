"""An SE as a `torch.nn.Module`, for use in any training code."""

import torch
from torch import Tensor, nn

from bilevel.synthetic_env.architecture import NETWORKS, Architecture
from bilevel.synthetic_env.storage import StoredSE
from bilevel.torch_activations import activation_module


class SEModule(nn.Module):
    """Three MLPs on concat(one_hot(action), state), with the parameters of an SE.

    Outputs are differentiable in the states. The parameters are not trained: call
    `requires_grad_(True)` on the module for gradients in them.
    """

    def __init__(self, se: StoredSE) -> None:
        super().__init__()
        self.architecture: Architecture = se.architecture
        parts = se.architecture.split(se.psi)
        for name, net, part in zip(NETWORKS, se.architecture.networks, parts, strict=True):
            layers: list[nn.Module] = []
            for n_in, n_out in net.shapes:
                layers += [
                    nn.Linear(n_in, n_out),
                    activation_module(se.architecture.activation),
                ]
            module = nn.Sequential(*layers[:-1])
            linear = [p for n, p in module.named_parameters() if not _is_slope(module, n)]
            nn.utils.vector_to_parameters(torch.from_numpy(part.copy()), linear)
            for parameter in linear:
                parameter.data = parameter.data.clone()  # not a view of the whole vector
            self.add_module(name, module)
        self.requires_grad_(False)

    def forward(self, state: Tensor, action: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Next state (..., S), reward (...,) and raw done (...,), for states
        (..., S) float32 and actions (...,) int64. An episode ends at done > 0.5."""
        one_hot = nn.functional.one_hot(action, self.architecture.n_actions)
        inputs = torch.cat([one_hot.to(state.dtype), state], dim=-1)
        outputs = [self.get_submodule(name)(inputs) for name in NETWORKS]
        return outputs[0], outputs[1].squeeze(-1), outputs[2].squeeze(-1)


def _is_slope(module: nn.Sequential, parameter: str) -> bool:
    return isinstance(module[int(parameter.split(".")[0])], nn.PReLU)
