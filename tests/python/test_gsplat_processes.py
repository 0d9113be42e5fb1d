# SPDX-License-Identifier: Apache-2.0
"""SplatBoostStrategy in several processes, with Gaussians split as in gsplat's simple_trainer, gives the results of one."""

import os
import pathlib
import subprocess
import sys

import conftest
import gsplat_double
import pytest
import torch

import splatboost
from splatboost import distributed

pytestmark = pytest.mark.skipif(conftest.EMULATED, reason="processes of their own, on the CPU")
STEPS, LENGTH, CAMERAS, CAP = 135, 220, 2, 28


def run(processes, share, count):
    """Trains `count` Gaussians with two cameras per step, like two processes with one camera each. Every process does
    what gsplat's rasterization() distributes. Returns all Gaussians in the order of their ids, and their numbers on the
    way."""
    gsplat_double.install()
    import test_gsplat

    import splatboost.gsplat as module

    trainer = test_gsplat.Trainer(module, LENGTH, tau_d=0.5, gradient_threshold=1e-5, gradient_abs_threshold=1e-4,
                                  percent_dense=0.15, densify_interval=25, replaced_share=share)
    trainer.strategy.max_gaussians = CAP
    for name, p in trainer.params.items():
        own = torch.nn.Parameter(p.detach()[:count][processes.rank::processes.count].clone())
        trainer.params[name] = own
        trainer.optimizers[name].param_groups[0]["params"] = [own]
    shard = trainer.strategy._rows(trainer.params)
    sizes = []
    for step in range(STEPS):
        everyone = {n: shard.all_rows(p.detach()).requires_grad_() for n, p in trainer.params.items()}
        grads, absolute, radii = [], [], []
        for j in range(CAMERAS):
            view = (CAMERAS * step + j) % 3
            done, points = trainer.draw(trainer.cameras[view], everyone)
            (done.color - trainer.truths[view]).abs().mean().backward()
            info = trainer.info_of(done)
            trainer.fill(info, points)
            for found, values in ((grads, info["means2d"].grad), (absolute, info["means2d"].absgrad), (radii, info["radii"])):
                found.append(shard.own_rows(values[0]))
        for name, p in trainer.params.items():
            grad = shard.own_rows(everyone[name].grad)
            p.grad = grad if p.grad is None else p.grad + grad  # gradients accumulate between steps
        means2d = torch.zeros_like(torch.stack(grads), requires_grad=True)
        means2d.grad, means2d.absgrad = torch.stack(grads), torch.stack(absolute)
        info.update(means2d=means2d, radii=torch.stack(radii), n_cameras=CAMERAS)
        trainer.strategy.step_post_backward(trainer.params, trainer.optimizers, trainer.state, step, info)
        for optimizer in module.optimizers_at(trainer.strategy, trainer.optimizers, step):
            optimizer.step()
            optimizer.zero_grad(set_to_none=True)
        sizes.append(processes.rows(shard.ids).shape[0])
    return {n: shard.all_rows(p.detach()) for n, p in trainer.params.items()}, sizes


def main(rank, processes, folder, share, count):
    torch.distributed.init_process_group("gloo", init_method="file://%s/meet" % folder, rank=rank, world_size=processes)
    torch.set_num_threads(1)
    splatboost.set_threads(1)
    torch.save(run(distributed.Processes(), share, count), os.path.join(folder, "%d.pt" % rank))
    torch.distributed.destroy_process_group()


@pytest.mark.parametrize("share, count, several", [
    (0.0, 16, [2]),  # late pruning
    (0.3, 13, [2, 4]),  # under a cap, pruning that makes room within growth; the processes hold different numbers
])
def test_several_processes_leave_what_one_does(tmp_path, share, count, several):
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join([str(conftest.PACKAGE), str(pathlib.Path(__file__).parent)]),
                       OMP_NUM_THREADS="1", GLOO_SOCKET_IFNAME="lo")
    started = []
    for processes in (1, *several):
        folder = tmp_path / str(processes)
        folder.mkdir()
        started += [subprocess.Popen([sys.executable, __file__, str(rank), str(processes), str(folder), str(share), str(count)],
                                     env=environment, stderr=subprocess.PIPE, text=True) for rank in range(processes)]
    try:
        for process in started:
            _, said = process.communicate(timeout=300)
            assert process.returncode == 0, said
    finally:
        for process in started:
            process.kill()
    alone, sizes = torch.load(str(tmp_path / "1/0.pt"))
    assert max(sizes) == CAP and sizes[0] == count, "nothing grew"
    went = sizes[-1] if share == 0 else min(sizes[30:60])
    assert went < (CAP if share == 0 else sizes[0]), "nothing went"
    for processes in several:
        for rank in range(processes):
            rows, sizes_here = torch.load(str(tmp_path / ("%d/%d.pt" % (processes, rank))))
            assert sizes_here == sizes
            for name, value in alone.items():
                assert torch.equal(rows[name], value), (processes, rank, name)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3], float(sys.argv[4]), int(sys.argv[5]))
