# SPDX-License-Identifier: Apache-2.0
"""A test double of the parts of gsplat that SplatBoostStrategy uses: the class it derives from and four operations.

gsplat itself needs CUDA. The double reimplements its interface (names, arguments, effects on parameters, optimizer
states and state tensors); it does not test gsplat.
"""

import dataclasses
import sys
import types

import torch


@dataclasses.dataclass
class DefaultStrategy:
    prune_opa: float = 0.005
    prune_scale3d: float = 0.1
    reset_every: int = 3000
    absgrad: bool = False
    revised_opacity: bool = False
    verbose: bool = False

    def check_sanity(self, params, optimizers):
        assert {n for n, p in params.items() if p.requires_grad} == set(optimizers)

    def step_pre_backward(self, params, optimizers, state, step, info):
        info["means2d"].retain_grad()


    def initialize_state(self, scene_scale=1.0):
        return {}

    def step_post_backward(self, *args, **kwargs):
        pass


class MCMCStrategy:
    pass


def _rebuild(params, optimizers, state, keep, added, new_values=None):
    """Makes all tensors rows `keep`, then rows `added`; moments of added rows are zero, state tensors follow."""
    for name, old in list(params.items()):
        tail = old.detach()[added] if new_values is None or name not in new_values else new_values[name]
        new = torch.nn.Parameter(torch.cat([old.detach()[keep], tail]), requires_grad=old.requires_grad)
        params[name] = new
        group_state = optimizers[name].state.pop(old, {})
        for key, value in group_state.items():
            if key != "step":
                group_state[key] = torch.cat([value[keep], torch.zeros_like(value[added])])
        optimizers[name].param_groups[0]["params"] = [new]
        if group_state:
            optimizers[name].state[new] = group_state
    for key, value in state.items():
        if isinstance(value, torch.Tensor):
            state[key] = torch.cat([value[keep], value[added]])


def _where(mask):
    return mask.nonzero()[:, 0]


def duplicate(params, optimizers, state, mask):
    _rebuild(params, optimizers, state, torch.arange(len(mask)), _where(mask))


def split(params, optimizers, state, mask, revised_opacity=False):
    parents = _where(mask).repeat(2)
    moved = params["means"].detach()[parents] + 0.01 * torch.randn(len(parents), 3)
    smaller = params["scales"].detach()[parents] - torch.log(torch.tensor(1.6))
    _rebuild(params, optimizers, state, _where(~mask), parents, {"means": moved, "scales": smaller})


def remove(params, optimizers, state, mask):
    _rebuild(params, optimizers, state, _where(~mask), _where(mask)[:0])


def reset_opa(params, optimizers, state, value):
    old = params["opacities"]
    new = torch.nn.Parameter(old.detach().clamp(max=torch.logit(torch.tensor(value)).item()))
    params["opacities"] = new
    group_state = optimizers["opacities"].state.pop(old, {})
    for key, moment in group_state.items():
        if key != "step":
            group_state[key] = torch.zeros_like(moment)
    optimizers["opacities"].param_groups[0]["params"] = [new]
    if group_state:
        optimizers["opacities"].state[new] = group_state


def install():
    names = ("gsplat", "gsplat.strategy", "gsplat.strategy.ops")
    modules = {name: types.ModuleType(name) for name in names}
    modules["gsplat.strategy"].DefaultStrategy = DefaultStrategy
    modules["gsplat.strategy"].MCMCStrategy = MCMCStrategy
    for operation in (duplicate, split, remove, reset_opa):
        setattr(modules["gsplat.strategy.ops"], operation.__name__, operation)
    modules["gsplat"].strategy = modules["gsplat.strategy"]
    modules["gsplat.strategy"].ops = modules["gsplat.strategy.ops"]
    sys.modules.update(modules)
