# SPDX-License-Identifier: Apache-2.0
"""Several processes make the same decisions as one: torch.distributed with gloo, on the CPU."""

import json
import os
import pathlib
import subprocess
import sys

import conftest
import pytest
import reference
import torch

import splatboost
from splatboost import distributed
from splatboost._tensors import Place, counts_of

N, VIEWS, EVENTS = 24, 5, 3
#: Iterations of growth and of a late pruning, in a run of 600.
ITERATIONS, LATE = (100, 200, 250), 400
#: A view that process 1 owns.
FAILING = 1

pytestmark = pytest.mark.skipif(conftest.EMULATED, reason="processes of their own, on the CPU")


class Scene:
    """The Gaussians of this process: the rows of its shard, or all of them without a shard."""

    NAMES = ("means", "scales", "rotations", "opacities", "sh")

    def __init__(self, shard):
        from test_rasterize import gaussians

        values = {name: value.float() for name, value in gaussians(3).items()}
        self.cameras = [reference.turned_camera(40, 30, cx=14.0 + 3 * i) for i in range(VIEWS)]
        with torch.no_grad():
            self.truths = [self.draw(values, camera).color.clamp(0, 1) for camera in self.cameras]
        kept = torch.arange(N) % 3 > 0
        self.rows = {name: values[name][kept].clone() for name in self.NAMES}
        self.shard = shard(int(kept.sum()))
        if self.shard is not None:
            self.rows = {name: value[self.shard.mine] for name, value in self.rows.items()}

    @staticmethod
    def draw(values, camera, points=None):
        return splatboost.rasterize(camera, values["means"], values["opacities"], scales=values["scales"],
                                    rotations=values["rotations"], sh=values["sh"], sh_degree=3, beta=0.5, screen_points=points)

    def everyone(self):
        return self.rows if self.shard is None else {n: self.shard.all_rows(v) for n, v in self.rows.items()}


def run(processes, shards):
    """A few growths and prunings. Returns the remaining Gaussians in the order of ids, and the sizes on the way."""
    scene = Scene(lambda rows: distributed.Shard(rows, processes) if shards else None)
    adapter = splatboost.Adapter("vanilla", total_iterations=600, seed=7, tau_d=0.5, gradient_threshold=1e-5,
                                 gradient_abs_threshold=1e-4, percent_dense=0.15)
    shared = distributed.SharedAdapter(adapter, scene.shard, processes, max_gaussians=40)
    ids = scene.shard or distributed.Shard(scene.rows["means"].shape[0], distributed.Processes.__new__(Alone))
    sizes = []
    for iteration in ITERATIONS:
        values = scene.everyone()
        n = values["means"].shape[0]
        sums = [distributed.ExactSum(n) for _ in range(3)]
        for j in range(VIEWS):
            if processes.owner_of_view(j) != processes.rank:
                continue
            points = torch.zeros(n, 4, requires_grad=True)
            done = scene.draw(values, scene.cameras[j], points)
            (done.color - scene.truths[j]).abs().mean().backward()
            sums[0].add(points.grad[:, :2].norm(dim=1))
            sums[1].add(points.grad[:, 2:].norm(dim=1))
            sums[2].add((done.radii > 0).float())
        signed, absolute, seen = (s.total(processes) for s in sums)
        own = (lambda t: t) if scene.shard is None else scene.shard.own_rows
        means = [own((total / seen.clamp_min(1)).float()) for total in (signed, absolute)]
        views = views_of(scene, values)
        clone, split = shared.grow(iteration, views, scene_extent=1.0, gradients=means[0], gradients_abs=means[1],
                                   max_scales=scene.rows["scales"].amax(dim=1))
        origins = ids.grow(clone, split)
        scene.rows = {name: torch.cat([v[~split], v[clone], v[split], v[split]]) for name, v in scene.rows.items()}
        draws = ids.normal(3, iteration, 3)
        children = torch.arange(len(origins)) >= len(origins) - 2 * int(split.sum())
        scene.rows["means"] = scene.rows["means"] + draws * scene.rows["scales"] * children.unsqueeze(1)
        scene.rows["scales"] = torch.where(children.unsqueeze(1), scene.rows["scales"] / 1.6, scene.rows["scales"])
        opacities = scene.rows["opacities"].reshape(-1)
        if scene.shard is None:  # origins as rows before growth; with a shard they come from the ids
            rows = torch.arange(len(split))
            origins = torch.cat([rows[~split], rows[clone], rows[split], rows[split]])
        remove = shared.prune(iteration, views, candidates=opacities < 0.45, opacities=opacities, origins=origins)
        ids.remove(remove)
        scene.rows = {name: v[~remove] for name, v in scene.rows.items()}
        sizes.append((int(clone.sum()), int(split.sum()), int(remove.sum()), scene.everyone()["means"].shape[0]))
    opacities = scene.rows["opacities"].reshape(-1)
    remove = shared.prune(LATE, views_of(scene, scene.everyone()), candidates=torch.zeros_like(opacities, dtype=torch.bool),
                          opacities=opacities, clearances=10 * scene.rows["means"][:, 0].abs())
    ids.remove(remove)
    scene.rows = {name: v[~remove] for name, v in scene.rows.items()}
    # In the order of ids, also if every process holds all Gaussians.
    order = torch.sort(ids.ids)[1] if scene.shard is None else slice(None)
    return {name: value[order] for name, value in scene.everyone().items()}, sizes


class Alone(distributed.Processes):
    rank, count, group = 0, 1, None


def views_of(scene, values):
    def view(j):
        def draw():
            with torch.no_grad():
                done = scene.draw(values, scene.cameras[j])
            return splatboost.ScoredView(done.color, scene.truths[j], None, done)

        return draw

    return [view(j) for j in range(VIEWS)]


class Counter:
    """A render that adds its view's number to every count."""

    def __init__(self, number):
        self.number = number

    def _add_counts(self, flagged, counts, place):
        self._add_weights(counts, place)

    def _add_weights(self, weights, place):
        if self.number == FAILING:
            raise ValueError("no lists")
        counts_of(weights, place).add_(self.number)


def check_failures(processes):
    """Views that fail in their owner raise in every process, and later views are not affected."""
    def photo(j, kind):
        def draw():
            if (j, kind) == (FAILING, "drawing"):
                raise ValueError("no photo")
            size = 3 if (j, kind) == (FAILING, "shape") else 4
            return splatboost.ScoredView(torch.full((3, 4, 5), float(j)), torch.zeros(3, size, 5), None, Counter(j))

        return draw

    def raised(call):
        with pytest.raises(Exception) as caught:
            call()
        return str(caught.value)

    owns = processes.rank == processes.owner_of_view(FAILING)
    for kind in ("drawing", "shape", "counting"):
        views = distributed.shared_views([photo(j, kind) for j in range(VIEWS)], processes, "cpu")
        for j, view in enumerate(views):
            if j == FAILING and kind != "counting":
                said = raised(view)
                assert owns or said == "rendering view 1 failed in process 1, whose own error tells why", said
                assert not owns or kind == "shape" or said == "no photo", said
                continue
            scored, sums = view(), torch.zeros(3, dtype=torch.int32)
            assert float(scored.color.mean()) == j
            place = Place(sums, "sums")
            for add in (lambda: scored.render._add_counts(None, place.target(sums, "sums"), place),
                        lambda: scored.render._add_weights(place.target(sums, "sums"), place)):
                if j == FAILING:
                    said = raised(add)
                    assert said == "no lists" if owns else "view 1 failed in process 1" in said, said
                else:
                    add()
            assert sums.tolist() == [0 if j == FAILING else 2 * j] * 3


def main(rank, count, folder):
    torch.distributed.init_process_group("gloo", init_method="file://%s/meet" % folder, rank=rank, world_size=count)
    torch.set_num_threads(1)
    processes = distributed.Processes()
    assert (processes.rank, processes.count) == (rank, count)
    torch.save([run(processes, shards) for shards in (False, True)], os.path.join(folder, "%d.pt" % rank))
    check_failures(processes)
    # Process 0 has no rows; sums require integers.
    rows = processes.rows(torch.full((rank, 2), float(rank)))
    assert rows.shape == (sum(range(count)), 2)
    try:
        processes.sum(torch.zeros(1))
    except ValueError as error:
        assert "expected int64" in str(error)
    else:
        raise AssertionError
    torch.distributed.destroy_process_group()


@pytest.fixture(scope="module")
def alone():
    rows, sizes = run(distributed.Processes(), False)
    assert sum(clone for clone, _, _, _ in sizes) and sum(split for _, split, _, _ in sizes)
    assert sum(removed for _, _, removed, _ in sizes)
    assert max(n for *_, n in sizes) <= 40
    return rows


def test_one_process_with_a_shard_leaves_the_same_gaussians(alone):
    rows, _ = run(distributed.Processes(), True)
    assert all(torch.equal(rows[name], value) for name, value in alone.items())


@pytest.mark.parametrize("count", [2, 4])
def test_any_number_of_processes_leaves_the_same_gaussians(tmp_path, alone, count):
    """With views distributed over processes, and with Gaussians distributed too."""
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join([str(conftest.PACKAGE), str(pathlib.Path(__file__).parent)]),
                       OMP_NUM_THREADS="1", GLOO_SOCKET_IFNAME="lo")
    started = [subprocess.Popen([sys.executable, __file__, str(rank), str(count), str(tmp_path)],
                                env=environment, stderr=subprocess.PIPE, text=True) for rank in range(count)]
    try:
        for process in started:
            _, said = process.communicate(timeout=120)
            assert process.returncode == 0, said
    finally:
        for process in started:
            process.kill()
    for rank in range(count):
        for rows, sizes in torch.load(str(tmp_path / ("%d.pt" % rank))):
            assert len({n for *_, n in sizes}) > 1, "nothing grew or went"
            for name, value in alone.items():
                assert torch.equal(rows[name], value), (rank, name)


def test_the_cost_of_decisions_is_measured_in_one_process_and_in_two():
    script = pathlib.Path(__file__).parents[2] / "scripts/score_in_processes"
    done = subprocess.run([sys.executable, script, "--gaussians", "200", "--size", "32", "24", "--repeats", "1",
                           "--processes", "1", "2"], capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    seconds = json.loads(done.stdout)["seconds"]
    assert list(seconds) == ["1", "2"] and min(seconds.values()) > 0


def test_draws_hang_on_ids_alone():
    whole = distributed.Shard(1000)
    part = distributed.Shard(1000)
    part.ids = whole.ids[[7, 3, 999]]
    draws = whole.normal(1, 20, 3)
    assert torch.equal(part.normal(1, 20, 3), draws[[7, 3, 999]])
    assert not torch.equal(whole.normal(2, 20, 3), draws) and not torch.equal(whole.normal(1, 21, 3), draws)
    assert abs(draws.mean()) < 0.06 and abs(draws.std() - 1) < 0.04
    assert abs(torch.corrcoef(draws.T) - torch.eye(3)).max() < 0.12
    assert len(draws.unique()) == 3000
    large = [whole.normal(seed, 20, 3) for seed in (torch.default_generator.initial_seed(), 67280421310721, 2**64 - 1)]
    assert all(torch.isfinite(d).all() and not torch.equal(d, draws) for d in large)


def test_sums_of_any_split_are_the_same():
    values = torch.rand(7, 50) * torch.logspace(-8, 2, 7).unsqueeze(1)
    sums = []
    for order in (range(7), reversed(range(7))):
        total = distributed.ExactSum(50)
        for i in order:
            total.add(values[i])
        sums.append(total.total(distributed.Processes()))
    assert torch.equal(*sums)
    assert torch.allclose(sums[0], values.double().sum(dim=0), atol=1e-11, rtol=0)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3])
