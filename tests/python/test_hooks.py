# SPDX-License-Identifier: Apache-2.0
"""The hooks in isolation. Whole patched hosts are tested in test_hosts.py."""

import types

import pytest
import torch

import splatboost
from splatboost.hooks import _boost, _drawing, absgs, deformable_3dgs, dropgaussian, mip_splatting, opacity_fields, pgsr, vanilla

N = 6


class Adapter:
    """A fake adapter with given decisions."""

    beta = 0.5

    def __init__(self, remove=(), prunes=True, resets_until=100):
        self.remove, self.prunes, self.resets_until = remove, prunes, resets_until

    def resets_opacities_at(self, iteration, host_would):
        return host_would and iteration < self.resets_until

    def prunes_at(self, iteration, host_would):
        return self.prunes

    def prune(self, iteration, views, *, candidates, origins=None, opacities=None, clearances=None, max_primitives=0):
        self.candidates = candidates
        self.clearances = clearances
        self.max_primitives = max_primitives
        mask = torch.zeros_like(candidates)
        mask[list(self.remove)] = True
        return mask

    def steps_at(self, group, iteration):
        return group != "slow" or iteration % 3 == 0

    def rate_factor(self, group, iteration):
        return 1.0

    def averages_at(self, iteration):
        return iteration in (96, 98, 100)


class Model:
    """A host's model with N numbers, and with tmp_radii as in 3DGS since October 2024."""

    def __init__(self):
        self.value = torch.nn.Parameter(torch.arange(float(N)))
        self.slow = torch.nn.Parameter(torch.zeros(2))
        self.optimizer = torch.optim.Adam([{"params": [self.value], "name": "xyz", "lr": 0.1},
                                           {"params": [self.slow], "name": "slow", "lr": 0.1}])
        self.denom = torch.zeros(N, 1)
        self.percent_dense = 0.01
        self.tmp_radii = None
        self.filters, self.resets = 0, 0

    get_xyz = property(lambda self: self.value)
    get_opacity = property(lambda self: torch.sigmoid(self.value.detach()).unsqueeze(1))

    def prune_points(self, mask):
        self.tmp_radii = self.tmp_radii[~mask]
        self.value = torch.nn.Parameter(self.value.detach()[~mask])

    def add_densification_stats(self, points, seen):
        self.denom[seen.reshape(-1)] += 1

    def compute_3D_filter(self, cameras):
        self.filters += 1

    def reset_opacity(self):
        self.resets += 1


def boost_of(kind=vanilla, adapter=None, **state):
    boost = kind.Boost.__new__(kind.Boost)
    boost.on, boost.gaussians, boost.adapter = True, Model(), adapter or Adapter()
    boost.options = types.SimpleNamespace(iterations=100, opacity_reset_interval=30, boost_max_gaussians=70)
    boost.iteration, boost._checkpoints, boost._device = 50, frozenset([7]), torch.device("cpu")
    boost._scene = types.SimpleNamespace(getTrainCameras=lambda: [])
    boost._restart_statistics()
    boost._averages = _boost.Averages()
    for name, value in state.items():
        setattr(boost, name, value)
    return boost


def test_waiting_groups_gather_gradients_and_lose_none():
    boost = boost_of()
    model = boost.gaussians
    other = Model()
    for iteration in range(1, 10):
        boost.begin(iteration)
        gradient = torch.tensor([1.0, -2.0]) * iteration
        (model.slow * gradient).sum().backward()
        boost.optimizer.step()
        boost.optimizer.zero_grad(set_to_none=True)
        # The expected result: a step on the sum of three gradients.
        (other.slow * gradient).sum().backward()
        if iteration % 3 == 0 or iteration == 7:  # at 7 the host writes a checkpoint
            other.optimizer.step()
            other.optimizer.zero_grad(set_to_none=True)
        assert torch.equal(model.slow.detach(), other.slow.detach())
        assert (model.slow.grad is None) == (other.slow.grad is None)


def test_a_gradient_that_is_not_a_number_counts_as_zero():
    sums, counts = torch.tensor([[float("nan")], [6.0], [0.0]]), torch.tensor([[2.0], [3.0], [0.0]])
    assert _boost.mean_gradients(sums, counts).reshape(-1).tolist() == [0.0, 2.0, 0.0]
    boost = boost_of()
    boost.gaussians.xyz_gradient_accum = torch.full((N, 1), float("nan"))
    boost._absolute[2] = float("nan")
    assert not boost._signed_gradients().any() and not boost._absolute_gradients().any()
    for host in (absgs, mip_splatting):
        boost = boost_of(host)
        boost.gaussians.xyz_gradient_accum_abs = torch.full((N, 1), float("nan"))
        assert not boost._absolute_gradients().any()


@pytest.mark.parametrize("iteration, steps", [(1, False), (3, True), (7, True), (98, False), (99, True)])
def test_groups_step_by_schedule_at_checkpoints_and_at_the_hosts_last_step(iteration, steps):
    assert boost_of(iteration=iteration).steps("slow") == steps
    assert boost_of(iteration=iteration).steps("xyz")


def test_gradients_are_applied_before_gaussians_go():
    boost = boost_of(adapter=Adapter(remove=[0]))
    before = boost.gaussians.value.detach().clone()
    boost.gaussians.value.sum().backward()
    boost.prune_late()
    assert torch.all(boost.gaussians.value.detach() < before[1:])


def test_late_pruning_gives_the_host_radii_and_takes_them_back():
    boost = boost_of(adapter=Adapter(remove=[1, 4]))
    boost._absolute[:, 0] = torch.arange(float(N))
    boost.prune_late()
    assert boost.gaussians.value.tolist() == [0, 2, 3, 5]
    assert boost._absolute.reshape(-1).tolist() == [0, 2, 3, 5]
    assert boost.gaussians.tmp_radii is None


@pytest.mark.parametrize("on", [True, False])
def test_a_fork_may_remove_gaussians_outside_of_growth(on):
    boost = boost_of(on=on)
    model, before = boost.gaussians, boost.gaussians.value.detach().clone()
    model.tmp_radii = torch.zeros(N)
    boost._absolute[:, 0] = torch.arange(float(N))
    model.value.sum().backward()
    boost.prune_points(torch.arange(N) == 2)
    kept = torch.arange(N) != 2
    assert torch.equal(model.value.detach() < before[kept], torch.full((N - 1,), on))  # no gradient is lost
    if on:
        assert boost._absolute.reshape(-1).tolist() == [0, 1, 3, 4, 5]


def test_late_pruning_tells_the_cap_and_how_near_the_cameras_gaussians_are():
    boost = boost_of()
    boost._means = lambda: torch.cat([torch.eye(N)[:, :3].repeat(3, 1), torch.zeros(60, 3)])
    boost._scene.getTrainCameras = lambda: [types.SimpleNamespace(camera_center=torch.tensor([4.0, 0.0, 0.0]))]
    boost.adapter.settings = {"min_clearance": 0.0}
    boost._describe_scene()
    boost.prune_late()
    assert boost.adapter.clearances is None
    assert boost.adapter.max_primitives == 70
    boost.adapter.settings = {"min_clearance": 0.5}
    boost._describe_scene()
    boost._means = lambda: torch.tensor([[0.0, 0, 0], [3, 0, 0]])
    boost.prune_late()
    # The run began with points at distance 3 (three), 4 (most) and more; ten may be wrong, so the scene is at 4.
    assert torch.allclose(boost.adapter.clearances, torch.tensor([1.0, 0.25]))


def host_options(**changed):
    return types.SimpleNamespace(**dict({"iterations": 30000, "densify_from_iter": 500, "densify_until_iter": 15000,
                                         "densification_interval": 100, "densify_grad_threshold": 0.0002, "percent_dense": 0.01,
                                         "lambda_dssim": 0.2, "boost_beta": 0.5, "boost_tau_d": 5.0}, **changed))


def test_options_that_the_user_changed_reach_the_adapter():
    boost = boost_of()
    boost.options = host_options()
    assert boost._host_settings() == {}
    boost.options = host_options(percent_dense=0.02, lambda_dssim=0.1, densify_from_iter=1000)
    assert boost._host_settings() == {"percent_dense": 0.02, "lambda_dssim": 0.1, "densify_from": 1000}
    known = splatboost.Adapter("vanilla", total_iterations=30000).settings
    boost.options = host_options(densify_grad_threshold=0.0004)
    assert boost._host_settings() == {"gradient_threshold": 0.0004,
                                      "gradient_abs_threshold": pytest.approx(2 * known["gradient_abs_threshold"])}
    boost = boost_of(absgs)
    boost.options = host_options(densify_grad_threshold=0.0004, densify_grad_abs_threshold=0.0004, percent_dense=0.001)
    assert boost._host_settings() == {"gradient_threshold": 0.0004}


@pytest.mark.parametrize("screen_size, prunes, expected", [(20, True, [3]), (20, False, []), (None, True, [])])
def test_large_gaussians_are_candidates_if_host_and_adapter_prune_them(screen_size, prunes, expected):
    class Sized(Model):
        get_scaling = torch.tensor([0.1, 0.2, 0.2, 0.21, 0.1, 0.1])[:, None].expand(N, 3)
        get_opacity = torch.ones(N, 1)

    none = torch.zeros(N, dtype=torch.bool)
    boost = boost_of()
    boost.gaussians = Sized()
    boost.adapter.grow = lambda *given, **named: (none, none)
    boost.adapter.prunes_large_at = lambda iteration, host_would: host_would and prunes
    boost.adapter.settings = {"min_clearance": 0.0}
    boost._signed_gradients = boost._absolute_gradients = lambda: torch.zeros(N)
    boost._grow = lambda clone, split, extent: torch.arange(N)
    boost.densify_and_prune(0.0002, 0.005, 2.0, screen_size)
    assert torch.where(boost.adapter.candidates)[0].tolist() == expected


def test_random_points_let_opacities_be_reset(monkeypatch):
    boost = boost_of()
    boost._scene.getTrainCameras = lambda: [types.SimpleNamespace(camera_center=torch.tensor([4.0, 0.0, 0.0]))]
    given = []
    monkeypatch.setattr(_boost, "adapter_of", lambda backbone, options, device, settings: given.append(settings) or boost.adapter)
    boost._settings = lambda: {"tau_d": 5.0}
    boost.adapter.settings = {"min_clearance": 0.8}
    torch.manual_seed(0)
    boost._means = lambda: 2 * torch.rand(1000, 3) - 1
    boost._describe_scene()
    assert given == [{"tau_d": 5.0, "random_points": True}]
    surface = torch.rand(1000, 3)
    surface[:, 0] = 1
    boost._means = lambda: surface
    boost._describe_scene()
    assert len(given) == 1


def test_the_adapter_learns_how_many_photos_there_are(monkeypatch):
    boost = boost_of()
    boost._scene.getTrainCameras = lambda: [object()] * 7
    given = []
    monkeypatch.setattr(_boost, "adapter_of", lambda backbone, options, device, settings: given.append(settings) or boost.adapter)
    boost._settings = lambda: {"tau_d": 5.0}
    boost.adapter.settings = {"min_clearance": 0.0, "training_views": 0}
    boost._describe_scene()
    assert given == [{"tau_d": 5.0, "training_views": 7}]
    boost.adapter.settings = {}  # an adapter that does not ask
    boost._describe_scene()
    assert len(given) == 1


def looking_along_z(z):
    """A camera of 90° at this z: 3DGS's matrix, of which the last column is the depth."""
    matrix = torch.zeros(4, 4)
    matrix[0, 0] = matrix[1, 1] = matrix[2, 2] = matrix[2, 3] = 1.0
    matrix[3, 2] = matrix[3, 3] = -z
    return types.SimpleNamespace(full_proj_transform=matrix)


def test_the_adapter_learns_how_far_the_scene_is(monkeypatch):
    cameras = [looking_along_z(0.0), looking_along_z(-2.0), looking_along_z(100.0)]  # the last sees nothing
    means = torch.tensor([[0.0, 0, 3], [0, 0, 4], [0, 0, 9], [90, 0, 1]])
    assert _boost.typical_depth(cameras[:1], means) == 4 and _boost.typical_depth(cameras[1:], means) == 6
    assert _boost.typical_depth(cameras[2:], means) == 0
    many = torch.zeros(250000, 3)
    many[:, 2] = torch.linspace(1, 2, 250000)
    assert abs(_boost.typical_depth(1000 * cameras[:1], many) - 1.5) < 1e-3
    boost = boost_of()
    boost._scene = types.SimpleNamespace(getTrainCameras=lambda: cameras[:1], cameras_extent=0.5)
    given = []
    monkeypatch.setattr(_boost, "adapter_of", lambda backbone, options, device, settings: given.append(settings) or boost.adapter)
    boost._settings = lambda: {}
    boost._means = lambda: means
    boost.adapter.settings = {"rate_by_depth": True}
    boost._describe_scene()
    boost.adapter.settings = {"rate_by_depth": False}
    boost._describe_scene()
    boost._scene.cameras_extent, boost.adapter.settings = 0.0, {"rate_by_depth": True}  # one camera
    boost._describe_scene()
    assert given == [{"depth_ratio": 8.0}]


def test_late_pruning_never_removes_all():
    boost = boost_of(adapter=Adapter(remove=range(N)))
    boost.prune_late()
    assert boost.gaussians.value.tolist() == [N - 1]  # the most opaque one


def test_resets_are_the_adapters_to_decide():
    boost = boost_of(adapter=Adapter(resets_until=60))
    boost.begin(59)
    boost.reset_opacity()
    boost.begin(60)
    boost.reset_opacity()
    assert boost.gaussians.resets == 1


def test_mip_splatting_renews_its_filter_after_late_pruning():
    boost = boost_of(mip_splatting, Adapter(remove=[0]))
    boost.prune_late()
    assert boost.gaussians.filters == 1


@pytest.mark.parametrize("iteration, renewed", [(400, 0), (450, 0), (500, 1), (1000, 1), (1100, 0), (1900, 0)])
def test_mip_splatting_renews_its_filter_when_growth_has_ended(iteration, renewed):
    adapter = Adapter(prunes=False)
    adapter.grows_at = lambda iteration, host_would: iteration < 500
    boost = boost_of(mip_splatting, adapter, iteration=iteration, options=types.SimpleNamespace(
        iterations=2000, densify_from_iter=100, densify_until_iter=1000, densification_interval=100))
    boost.prune_late()
    assert boost.gaussians.filters == renewed  # before, growth renews it; after densify_until_iter, the host
    boost.on = False
    boost.prune_late()
    assert boost.gaussians.filters == renewed


def test_mip_splatting_keeps_its_filter_at_the_end_of_a_short_run():
    adapter = Adapter(prunes=False)
    adapter.grows_at = lambda iteration, host_would: False
    boost = boost_of(mip_splatting, adapter, options=types.SimpleNamespace(
        iterations=700, densify_from_iter=500, densify_until_iter=15000, densification_interval=100))
    for iteration in range(1, 701):
        boost.begin(iteration)
        boost.prune_late()
    assert boost.gaussians.filters == 5


@pytest.mark.parametrize("seen", [torch.tensor([True, False, True, False, False, False]), torch.tensor([[0], [2]])])
@pytest.mark.parametrize("kind, views", [(vanilla, 1.0), (dropgaussian, 1 / (1 - 0.2 * 5000 / 10000))])
def test_statistics_take_masks_and_indices_and_weigh_views(seen, kind, views):
    boost = boost_of(kind, iteration=5000)
    points = torch.zeros(N, 4, requires_grad=True)
    points.grad = torch.tensor([[0.0, 0, 3, 4]]).repeat(N, 1)
    boost.gaussians.splatboost = _drawing.Drawing(0.5, absolute=True)
    boost.gaussians.splatboost.screen_points = points
    boost.add_densification_stats(torch.zeros(N, 3), seen)
    expected = torch.zeros(N, 1)
    expected[[0, 2]] = views
    assert torch.allclose(boost.gaussians.denom, expected)
    assert torch.allclose(boost._seen, expected)
    assert torch.allclose(boost._absolute, 5 * (expected > 0).float())


def test_candidates_by_absolute_gradients_are_the_hosts_own():
    boost = boost_of(deformable_3dgs)
    boost.options.densify_grad_threshold, boost.gaussians.percent_dense = 0.0007, 0.01
    gradients = torch.tensor([[0.0006], [0.0008], [0.0009], [0.0], [0.001], [0.0001]])
    scales = torch.tensor([0.01, 0.02, 0.03, 0.03, 0.02, 0.01])
    own = boost._own_growth(gradients, scales, 2.0)
    assert own["clone"].tolist() == [False, True, False, False, True, False]
    assert own["split"].tolist() == [False, False, True, False, False, False]
    boost.options.boost_beta, boost.options.boost_tau_d = 0.5, 5.0
    boost.options.densify_from_iter, boost.options.densify_until_iter = 500, 15000
    boost.options.densification_interval = 100
    assert boost._settings()["absgrad"] is False
    boost.options.densify_grad_threshold = 0.0002
    paper = deformable_3dgs.BoostOfPaper.__new__(deformable_3dgs.BoostOfPaper)
    paper.options = boost.options
    assert paper._settings()["absgrad"] is True, "on the branch paper they are 3DGS's"


@pytest.mark.parametrize("moves", [False, True])
def test_a_view_is_drawn_at_its_own_time(moves):
    class Camera:
        fid, loaded = torch.tensor([0.25]), 0

    class Deform:
        def step(self, xyz, time):
            return 4 * time, 1.0, 2.0

    gaussians = types.SimpleNamespace(get_xyz=torch.zeros(N, 3))

    def render(camera, pc, pipe, background, d_xyz, d_rotation, d_scaling, is_6dof):
        assert (d_rotation, d_scaling, is_6dof) == ((1.0, 2.0, True) if moves else (0.0, 0.0, True))
        return {"render": pc.get_xyz + d_xyz}

    drawn = deformable_3dgs.at_its_time(render, Camera(), gaussians, None, torch.zeros(3), Deform(), moves, True)
    assert torch.equal(drawn, torch.full((N, 3), 1.0 if moves else 0.0))


def test_a_camera_in_host_memory_is_moved_to_be_scored_and_back():
    """With --load2gpu_on_the_fly. The device "meta" stands for the memory that the camera is not in."""
    class Camera:
        def __init__(self):
            self.places = []
            self.load2device("elsewhere")

        def load2device(self, data_device="cuda"):
            self.places.append(data_device)
            self.fid = torch.tensor([0.25], device="cpu" if data_device == "cuda" else "meta")

    class Deform:
        def step(self, xyz, time):
            return 4 * time, 1.0, 2.0

    def render(camera, pc, pipe, background, d_xyz, d_rotation, d_scaling, is_6dof):
        return {"render": pc.get_xyz + d_xyz}

    camera, gaussians = Camera(), types.SimpleNamespace(get_xyz=torch.zeros(N, 3))
    drawn = deformable_3dgs.at_its_time(render, camera, gaussians, None, torch.zeros(3), Deform(), True, False)
    assert torch.equal(drawn, torch.full((N, 3), 1.0))
    assert camera.places == ["elsewhere", "cuda", "cpu"]


def test_changed_densify_functions_are_noticed():
    boost = boost_of()
    with pytest.raises(RuntimeError, match="densify functions were changed"):
        boost._check_count(torch.arange(N + 1), "cloned")


def test_off_passes_whatever_the_host_passes():
    boost, calls = boost_of(on=False), []

    def host(name):
        def called(*given, **named):
            calls.append((name, given, named))
            return name
        return called

    for name in ("add_densification_stats", "densify_and_prune", "reset_opacity"):
        setattr(boost.gaussians, name, host(name))
        assert getattr(boost, name)(1, 2, 3, 4, 5, 6, seventh=7) == name
        assert calls.pop() == (name, (1, 2, 3, 4, 5, 6), {"seventh": 7})


def test_beta_stays_with_the_model_folder(tmp_path):
    model = types.SimpleNamespace()
    vanilla.load(model, str(tmp_path))
    assert not hasattr(model, "splatboost")
    _drawing.save(str(tmp_path), "vanilla", 0.7)
    vanilla.load(model, str(tmp_path))
    assert model.splatboost.beta == 0.7
    _drawing.forget(str(tmp_path))
    _drawing.forget(str(tmp_path))
    assert list(tmp_path.iterdir()) == []


def told_by_load(capsys, hooks, folder):
    with pytest.raises(SystemExit) as ended:
        hooks.load(types.SimpleNamespace(), str(folder))
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert told.startswith(str(folder / "splatboost.json") + ": ") and told.count("\n") == 1
    assert told.endswith("; delete it to render with the host's own box\n")
    return told


@pytest.mark.parametrize("text, reason", [
    ("", "not JSON (Expecting value: line 1"), ("{", "not JSON"), ("\udcff", "not JSON"), ("[]", "got []"), ("null", "got None"),
    ('{"backbone": "vanilla"}', "expected an object with backbone and beta"),
    ('{"beta": 0.5}', "expected an object with backbone and beta"),
    ('{"backbone": "vanilla", "beta": 2}', "beta: expected a number in (0, 1] or null, got 2"),
    ('{"backbone": "vanilla", "beta": NaN}', "got nan"), ('{"backbone": "vanilla", "beta": true}', "got True"),
    ('{"backbone": "vanilla", "beta": "0.5"}', "got '0.5'")])
def test_a_damaged_file_of_the_beta_is_told_in_one_line(tmp_path, capsys, text, reason):
    (tmp_path / "splatboost.json").write_bytes(text.encode("utf-8", "surrogateescape"))
    assert reason in told_by_load(capsys, vanilla, tmp_path)


def test_a_file_of_the_beta_that_cannot_be_read_is_told_in_one_line(tmp_path, capsys):
    (tmp_path / "splatboost.json").mkdir()
    assert "Is a directory" in told_by_load(capsys, vanilla, tmp_path)


def test_a_beta_of_another_backbone_is_not_used(tmp_path, capsys):
    _drawing.save(str(tmp_path), "mip-splatting", 0.5)
    told = told_by_load(capsys, vanilla, tmp_path)
    assert "the model was trained as 'mip-splatting', and this host renders 'vanilla'" in told
    model = types.SimpleNamespace()
    mip_splatting.load(model, str(tmp_path))
    assert model.splatboost.beta == 0.5


@pytest.mark.parametrize("option, value, told", [
    ("boost_beta", 2.0, "must be in (0, 1], got 2.0"), ("boost_beta", float("nan"), "expected a finite number, got nan"),
    ("boost_tau_d", float("inf"), "expected a finite number, got inf"), ("boost_tau_d", -1.0, "must be at least 0, got -1.0"),
    ("iterations", 0, "expected at least 1, got 0"), ("densification_interval", 0, "must be at least 1, got 0"),
    ("densify_from_iter", -4, "must be at least 0, got -4"), ("densify_grad_threshold", -1.0, "must be at least 0, got -1.0"),
    ("densify_until_iter", 10**10, "expected a whole number from -2147483648 to 2147483647, got 10000000000")])
def test_a_bad_option_is_told_with_its_name_and_value(tmp_path, capsys, option, value, told):
    options = types.SimpleNamespace(
        boost="on", boost_beta=0.5, boost_tau_d=5.0, boost_max_gaussians=0, iterations=100, densify_from_iter=400,
        densify_until_iter=15000, densification_interval=100, densify_grad_threshold=0.0002)
    setattr(options, option, value)
    with pytest.raises(SystemExit) as ended:
        vanilla.Boost(types.SimpleNamespace(get_xyz=torch.zeros(N, 3)), None, options, None, str(tmp_path))
    assert ended.value.code == 2
    assert capsys.readouterr().err == "--%s: %s\n" % (option, told)


def test_a_setting_that_no_option_gives_is_told_by_its_own_name(capsys):
    with pytest.raises(SystemExit) as ended:
        _boost.adapter_of("vanilla", types.SimpleNamespace(iterations=100), torch.device("cpu"), {"views": 0})
    assert ended.value.code == 2
    assert capsys.readouterr().err == "SplatBoost: --boost options: views must be at least 1\n"


def test_options_of_the_user_hold_and_scale():
    boost = boost_of()
    boost.options = types.SimpleNamespace(
        boost_beta=0.5, boost_tau_d=5.0, iterations=3000, densify_from_iter=500, densify_until_iter=2000,
        densification_interval=50, densify_grad_threshold=0.0002)
    assert boost._settings() == {"beta": 0.5, "tau_d": 5.0, "densify_until": 20000, "densify_interval": 50}


@pytest.mark.parametrize("kind, until, iterations", [
    (vanilla, 15000, 80000), (dropgaussian, 10000, 30000), (pgsr, 15000, 80000), (deformable_3dgs, 15000, 90000)])
def test_the_host_lets_gaussians_grow_as_long_as_announced(tmp_path, capsys, kind, until, iterations):
    camera = types.SimpleNamespace(camera_center=torch.zeros(3), full_proj_transform=torch.eye(4))
    scene = types.SimpleNamespace(getTrainCameras=lambda: [camera], cameras_extent=1.0)

    def until_of(**given):
        options = types.SimpleNamespace(
            boost="on", boost_beta=0.5, boost_tau_d=5.0, boost_max_gaussians=0, iterations=iterations, densify_from_iter=500,
            densify_until_iter=until, densification_interval=100, densify_grad_threshold=0.0002)
        options.__dict__.update(given)
        boost = kind.Boost(types.SimpleNamespace(get_xyz=torch.zeros(N, 3)), scene, options, None, str(tmp_path))
        last = max(i for i in range(1, options.iterations + 1) if boost._grows_at(i))
        assert " to %d every" % last in capsys.readouterr().out
        return options.densify_until_iter, last

    own, last = until_of()
    assert own == last + 1 > until
    assert until_of(iterations=until)[0] == until  # in short runs growth ends earlier
    assert until_of(densify_until_iter=until - 1000)[0] == until - 1000  # the user's own value


@pytest.mark.parametrize("kind", [splatboost.NoCudaError, splatboost.LibraryError])
def test_a_library_that_cannot_train_is_told_in_one_line(monkeypatch, capsys, kind):
    def refused(*_, **__):
        raise kind("built without CUDA")

    monkeypatch.setattr(_boost, "Adapter", refused)
    with pytest.raises(SystemExit) as ended:
        _boost.adapter_of("vanilla", types.SimpleNamespace(iterations=100), torch.device("cpu"), {})
    assert ended.value.code == 2
    assert capsys.readouterr().err == "SplatBoost: built without CUDA; --boost off trains without it\n"


def test_hosts_rasterizer_is_used_without_boost():
    host = object()
    assert _drawing.rasterizer(types.SimpleNamespace(), host) is host
    assert isinstance(_boost.Boost.host_options, dict)


def test_gaussians_of_anchors_are_counted_as_their_slots():
    from test_rasterize import gaussians

    import reference
    from splatboost._tensors import Place
    from splatboost.hooks import _anchors

    values = {name: value.float() for name, value in gaussians(3).items()}
    n = values["means"].shape[0]
    done = splatboost.rasterize(reference.turned_camera(40, 30), values["means"], values["opacities"], scales=values["scales"],
                                rotations=values["rotations"], sh=values["sh"], sh_degree=3, beta=0.5)
    flagged = torch.rand(30, 40) > 0.5
    slots = torch.randperm(3 * n)[:n]
    place, counts = Place(done.radii, "radii"), torch.full((3 * n,), 5, dtype=torch.int32)
    _anchors._OfSlots(done, slots)._add_counts(place.view(flagged.to(torch.uint8), "flagged"), place.target(counts, "counts"), place)
    wanted = [5] * (3 * n)
    for i, count in enumerate(done.count_flagged(flagged).tolist()):
        wanted[int(slots[i])] += count
    assert counts.tolist() == wanted and max(wanted) > 5


def test_rates_of_groups_change_for_one_step_only():
    boost = boost_of(adapter=Adapter())
    boost.adapter.rate_factor = lambda group, iteration: {"slow": 0.25}.get(group, 1.0)
    model, boost.iteration = boost.gaussians, 3
    before = model.slow.detach().clone()
    (model.slow.sum() + model.value.sum()).backward()
    boost.optimizer.step()
    assert torch.allclose((before - model.slow).abs(), torch.full((2,), 0.025))
    assert [group["lr"] for group in model.optimizer.param_groups] == [0.1, 0.1]


def test_rates_of_anchors_fall_for_one_step_only():
    from splatboost.hooks import _anchors

    adapter = types.SimpleNamespace(rate_factor=lambda group, iteration: {"slow": 0.25}.get(group, 1.0))
    model = Model()
    boost = types.SimpleNamespace(adapter=adapter, iteration=9, gaussians=model)
    before = model.slow.detach().clone()
    (model.slow.sum() + model.value.sum()).backward()
    _anchors._WithRates(boost).step()
    assert torch.allclose((before - model.slow).abs(), torch.full((2,), 0.025))
    assert [group["lr"] for group in model.optimizer.param_groups] == [0.1, 0.1]


def test_rates_of_anchors_are_reduced_in_the_step_before_growth_too():
    from splatboost.hooks import _anchors

    boost = _anchors.Boost.__new__(_anchors.Boost)
    model = boost.gaussians = Model()
    boost.on, boost.iteration = True, 9
    boost.adapter = types.SimpleNamespace(rate_factor=lambda group, iteration: {"slow": 0.25}.get(group, 1.0))
    boost._gate = lambda: torch.ones(N, dtype=torch.bool)
    model.splatboost = types.SimpleNamespace(gate=None)
    model.adjust_anchor = lambda: model.splatboost.gate
    before = model.slow.detach().clone()
    model.slow.sum().backward()
    assert bool(boost.adjust_anchor().all())
    assert torch.allclose((before - model.slow).abs(), torch.full((2,), 0.025))
    assert model.slow.grad is None and model.splatboost.gate is None


def test_pgsr_draws_scored_views_without_planes_and_with_their_exposure():
    asked = []

    def render(camera, gaussians, pipe, background, **named):
        asked.append(named)
        return {"render": torch.zeros(2), **({"app_image": torch.ones(2)} if gaussians == "exposed" else {})}

    for gaussians, value in (("plain", 0.0), ("exposed", 1.0)):
        seen = pgsr.as_the_loss_sees(render, None, gaussians, None, None, "app")
        assert torch.equal(seen, torch.full((2,), value))
    assert asked == 2 * [{"app_model": "app", "return_plane": False, "return_depth_normal": False}]


def test_pgsr_grows_from_its_own_candidates():
    boost = boost_of(pgsr)
    g, options = boost.gaussians, boost.options
    options.densify_grad_threshold, options.densify_abs_grad_threshold = 0.0002, 0.0008
    g.percent_dense, g.abs_split_radii2D_threshold, g.max_abs_split_points = 0.01, 20, 2
    gradients = torch.tensor([[0.0003], [0.0003], [0.0], [0.0], [0.0], [0.0], [0.0]])
    scales = torch.tensor([0.01, 0.03, 0.03, 0.01, 0.03, 0.03, 0.03])
    g.xyz_gradient_accum_abs = 2 * torch.tensor([[0.1], [0.0], [0.001], [0.1], [0.1], [0.003], [0.002]])
    g.denom_abs = torch.full((7, 1), 2.0)
    g.max_radii2D = torch.tensor([50.0, 50.0, 50.0, 50.0, 20.0, 50.0, 50.0])
    own = boost._own_growth(gradients, scales, 2.0)
    assert own["clone"].tolist() == [True] + 6 * [False]
    # By signed gradients; and of those large on screen and blurred, the two with the largest absolute gradients.
    assert own["split"].tolist() == [False, True, False, False, False, True, True]
    options.boost_beta, options.boost_tau_d = 1.0, 5.0
    options.densify_from_iter, options.densify_until_iter, options.densification_interval = 500, 15000, 100
    assert boost._settings() == {"beta": 1.0, "tau_d": 5.0}


@pytest.mark.parametrize("given", [(), (0.2,)])
def test_opacity_fields_counts_with_the_hosts_kernel_size(monkeypatch, given):
    found = {}
    camera = types.SimpleNamespace(original_image=torch.zeros(3, 4, 4))
    g = types.SimpleNamespace(get_xyz=torch.zeros(2, 3), get_opacity_with_3D_filter=torch.ones(2, 1),
                              get_scaling_with_3D_filter=torch.ones(2, 3), get_rotation=torch.ones(2, 4))
    monkeypatch.setattr(opacity_fields, "rasterize", lambda *_, **named: found.update(named))
    monkeypatch.setattr(_drawing, "pinhole", lambda *_: None)
    options = types.SimpleNamespace(boost="off")
    boost = opacity_fields.Boost(g, None, options, lambda _: torch.zeros(3, 4, 4), "", (), *given)
    boost._render = lambda _: torch.zeros(3, 4, 4)
    boost._score(camera)
    assert found["low_pass"] == (given[0] if given else 0.0) and found["compensate_opacity"]


def test_opacity_fields_with_appearance_scores_what_the_loss_sees():
    image, camera = torch.rand(3, 40, 70), types.SimpleNamespace(idx=4)

    def doubled(inner, truth, gaussians, index, return_transformed_image):
        assert inner.shape == truth.shape == (3, 32, 64) and (gaussians, index) == ("g", 4) and return_transformed_image
        return 2 * inner

    seen = opacity_fields.as_the_loss_sees(image, camera, "g", doubled)
    expected = image.clone()
    expected[:, 4:36, 3:67] *= 2
    assert torch.equal(seen, expected)
    assert opacity_fields.as_the_loss_sees(image, camera, "g", None) is image
    small = image[:, :20]
    assert opacity_fields.as_the_loss_sees(small, camera, "g", doubled) is small
    boost = boost_of(opacity_fields)
    assert [boost.steps(group) for group in ("slow", "appearance_network", "appearance_embeddings")] == [False, True, True]


@pytest.mark.parametrize("host", [absgs, pgsr])
def test_a_host_without_tracked_points_says_so(capsys, host):
    options = types.SimpleNamespace(boost="on", use_prune_weight=False)
    with pytest.raises(SystemExit) as stopped:
        host.Boost(types.SimpleNamespace(get_xyz=torch.zeros(0, 3)), None, options, None, "")
    assert stopped.value.code == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "three photos" in told and "point_triangulator" in told
