# SPDX-License-Identifier: Apache-2.0
"""Miniature checkouts with the names, layout and pitfalls of real ones, written for the tests.

write_host(folder, layout) writes one; its train.py trains on a small synthetic scene.
"""

import pathlib

#: layout → recipe that fits it
RECIPES = {"3dgs-2023": "3dgs", "3dgs-2024-08": "3dgs", "3dgs-2024-10": "3dgs", "mip": "mip-splatting",
           "drop": "dropgaussian", "deform": "deformable-3dgs", "deform-paper": "deformable-3dgs", "absgs": "absgs", "2dgs": "2dgs",
           "gof": "gaussian-opacity-fields", "pgsr": "pgsr"}

ARGUMENTS = '''
class Options:
    """What a subclass has set when it calls offer() becomes an option."""

    def offer(self, parser, title):
        self.keys = sorted(self.__dict__)
        section = parser.add_argument_group(title)
        for key in self.keys:
            section.add_argument("--" + key, default=self.__dict__[key], type=type(self.__dict__[key]))

    def extract(self, args):
        self.__dict__.update((key, getattr(args, key)) for key in self.keys)
        return self


class ModelParams(Options):
    def __init__(self, parser):
        self.model_path = ""
        self.sh_degree = 1
        self.kernel_size = 0.1
        self.train_test_exp = 0
        self.is_6dof = 0
        self.offer(parser, "model")


class OptimizationParams(Options):
    def __init__(self, parser):
        self.iterations, self.densification_interval, self.opacity_reset_interval = 30_000, 100, 3000
        self.densify_from_iter, self.densify_until_iter = 500, @UNTIL@
        self.densify_grad_threshold = @THRESHOLD@
        self.warm_up = 20
        self.offer(parser, "Optimization Parameters")
'''

RENDERER = '''
import math
import torch
from diff_gaussian_rasterization import GaussianRasterizer, GaussianRasterizationSettings

def render(cam, pc, pipe, bg_color@SIGNATURE@):
    on_screen = torch.zeros_like(pc.get_xyz, requires_grad=True, device="cuda") * 1.0  # no leaf, as in the hosts
    if torch.is_grad_enabled():
        on_screen.retain_grad()@DENSIFY_POINTS@
    view = GaussianRasterizationSettings(
        image_height=cam.height, image_width=cam.width, tanfovx=cam.tanfovx, tanfovy=cam.tanfovy, bg=bg_color,
        scale_modifier=1.0, viewmatrix=cam.view, projmatrix=cam.full, sh_degree=pc.active_sh_degree, campos=cam.centre,
        prefiltered=False, debug=False@SETTINGS@)
    rasterizer = GaussianRasterizer(view)
    opacity = pc.get_opacity@FILTERED@
@DROPOUT@
    @RESULT@ = rasterizer(means3D=pc.get_xyz@MOVED@, means2D=on_screen,@DENSIFY@ opacities=opacity, shs=pc.get_features,
                          scales=pc.get_scaling@FILTERED@@STRETCHED@, rotations=pc.get_rotation@TURNED@)
    return {"render": rendered_image, "viewspace_points": on_screen,@DENSIFY_RESULT@
            "visibility_filter": @SEEN@, "radii": radii}
'''

MODEL = '''
import torch
from simple_knn._C import distCUDA2

NAMES = {"xyz": "_xyz", "f_dc": "_features_dc", "f_rest": "_features_rest", "opacity": "_opacity",
         "scaling": "_scaling", "rotation": "_rotation"}
RATES = {"xyz": 1e-3, "f_dc": 2.5e-3, "f_rest": 1e-4, "opacity": 5e-2, "scaling": 5e-3, "rotation": 1e-3}


class GaussianModel:
    def __init__(self, sh_degree):
        self.active_sh_degree = sh_degree

    get_xyz = property(lambda self: self._xyz)
    get_features = property(lambda self: torch.cat([self._features_dc, self._features_rest], dim=1))
    get_opacity = property(lambda self: torch.sigmoid(self._opacity))
    get_scaling = property(lambda self: torch.exp(self._scaling))
    get_rotation = property(lambda self: torch.nn.functional.normalize(self._rotation))
@MIP_PROPERTIES@
    def create(self, points):
        n = points.shape[0]
        distance = torch.sqrt(distCUDA2(points.cuda()).clamp_min(1e-7))
        values = {"xyz": points, "f_dc": torch.zeros(n, 1, 3), "f_rest": torch.zeros(n, 3, 3),
                  "opacity": torch.full((n, 1), -1.0), "scaling": torch.log(distance)[:, None].repeat(1, 3),
                  "rotation": torch.tensor([[1.0, 0, 0, 0]]).repeat(n, 1)}
        for name, value in values.items():
            setattr(self, NAMES[name], torch.nn.Parameter(value.float().cuda()))

    def training_setup(self, opt):
        self.percent_dense = 0.01
        self.optimizer = torch.optim.Adam(
            [{"params": [getattr(self, NAMES[name])], "lr": RATES[name], "name": name} for name in NAMES], lr=0.0, eps=1e-15)
        self.start_statistics()

    def start_statistics(self):
        n = self.get_xyz.shape[0]
        self.xyz_gradient_accum = torch.zeros((n, 1), device="cuda")
        self.denom = torch.zeros((n, 1), device="cuda")
        self.max_radii2D = torch.zeros((n,), device="cuda")
@MIP_START@
    def update_learning_rate(self, iteration):
        pass

    def change(self, change):
        """Every parameter and its moments through `change`."""
        groups = self.optimizer.param_groups
        for group in groups:
            old = group["params"][0]
            state = self.optimizer.state.pop(old)
            new = torch.nn.Parameter(change(group["name"], old.detach()))
            for key in ("exp_avg", "exp_avg_sq"):
                state[key] = change(group["name"], state[key], True)
            self.optimizer.state[new] = state
            group["params"][0] = new
            setattr(self, NAMES[group["name"]], new)

    def prune_points(self, mask):
        self.change(lambda name, value, moment=False: value[~mask])
        self.xyz_gradient_accum = self.xyz_gradient_accum[~mask]
        self.denom = self.denom[~mask]
        self.max_radii2D = self.max_radii2D[~mask]
@MIP_PRUNE@@RADII_PRUNE@
    def append(self, rows):
        def grown(name, value, moment=False):
            more = torch.zeros_like(rows[name]) if moment else rows[name]
            return torch.cat([value, more])
        self.change(grown)
        self.start_statistics()

    def rows(self, mask, times=1):
        return {name: getattr(self, NAMES[name]).detach()[mask].repeat((times,) + (1,) * (getattr(self, NAMES[name]).dim() - 1))
                for name in NAMES}

    def densify_and_clone(self, grads, grad_threshold, @ABSOLUTE@scene_extent):
        mask = torch.norm(grads, dim=-1) >= grad_threshold
        mask &= self.get_scaling.max(dim=1).values <= self.percent_dense * scene_extent
        rows = self.rows(mask)
@RADII_CLONE@
        self.append(rows)

    def densify_and_split(self, grads, grad_threshold, @ABSOLUTE@scene_extent, N=2):
        n = self.get_xyz.shape[0]
        mask = torch.zeros((n,), device="cuda")
        mask[:grads.shape[0]] = grads.reshape(-1)
        mask = mask >= grad_threshold
        mask &= self.get_scaling.max(dim=1).values > self.percent_dense * scene_extent
        rows = self.rows(mask, N)
        rows["xyz"] = rows["xyz"] + torch.normal(torch.zeros_like(rows["xyz"]), torch.exp(rows["scaling"]))
        rows["scaling"] = rows["scaling"] - 0.47
@RADII_SPLIT@
        self.append(rows)
        self.prune_points(torch.cat([mask, torch.zeros(N * int(mask.sum()), device="cuda", dtype=bool)]))

    def densify_and_prune(self, max_grad, min_opacity, extent, max_screen_size@RADII@):
        grads = torch.nan_to_num(self.xyz_gradient_accum / self.denom)
@RADII_SET@
        self.densify_and_clone(grads, max_grad, @ABSOLUTE_VALUES@extent)
        self.densify_and_split(grads, max_grad, @ABSOLUTE_VALUES@extent)
        self.prune_points((self.get_opacity < min_opacity).reshape(-1))
@RADII_UNSET@
    def add_densification_stats(self, on_screen, seen):
        self.xyz_gradient_accum[seen] += torch.norm(on_screen.grad[seen, :2], dim=-1, keepdim=True)
@MIP_STATS@
        self.denom[seen] += 1.0

    def reset_opacity(self):
        low = torch.minimum(self._opacity.detach(), torch.full_like(self._opacity, -4.6))
        self.change(lambda name, value, moment=False: value if name != "opacity" else (torch.zeros_like(low) if moment else low))
'''

SCENE = '''
import math
import os
import numpy as np
import torch
from scene.gaussian_model import GaussianModel, NAMES
@DEFORM_MODEL@

class Camera:
    def __init__(self, angle):
        self.width, self.height, self.image_name = 40, 32, "view%.1f" % angle
        self.tanfovx, self.tanfovy = 0.5, 0.4
        self.view = torch.eye(4)
        self.view[0, 0] = self.view[2, 2] = math.cos(angle)
        self.view[0, 2], self.view[2, 0] = math.sin(angle), -math.sin(angle)
        self.view[3, 2] = 4.0
        near, far = 0.01, 100.0
        projection = torch.zeros(4, 4)
        projection[0, 0], projection[1, 1] = 1 / self.tanfovx, 1 / self.tanfovy
        projection[2, 2], projection[3, 2], projection[2, 3] = far / (far - near), -far * near / (far - near), 1.0
        self.view = self.view.cuda()
        self.full = self.view @ projection.cuda()
        self.centre = torch.inverse(self.view)[3, :3]
        self.camera_center, self.full_proj_transform = self.centre, self.full
        y, x = torch.meshgrid(torch.arange(32.0), torch.arange(40.0), indexing="ij")
        stripes = 0.5 + 0.5 * torch.sin(x / 2 + angle) * torch.cos(y / 3)
        self.original_image = torch.stack([stripes, 1 - stripes, x / 40]).to("cuda")
        self.alpha_mask = torch.ones(1, 32, 40)
        self.fid = torch.tensor([angle + 0.2]).cuda()


class Scene:
    def __init__(self, dataset, gaussians, load_iteration=None, shuffle=True):
        self.model_path, self.gaussians, self.cameras_extent, self.loaded_iter = dataset.model_path, gaussians, 2.0, load_iteration
        self.cameras = [Camera(0.1 * i - 0.2) for i in range(5)]
        if load_iteration is None:
            gaussians.create(torch.randn(60, 3) * 0.6)
        else:
            for name, value in np.load(os.path.join(self.model_path, "model.npz")).items():
                setattr(gaussians, NAMES[name], torch.tensor(value).cuda())

    def getTrainCameras(self):
        return self.cameras

    def save(self, iteration):
        np.savez(os.path.join(self.model_path, "model.npz"),
                 **{name: getattr(self.gaussians, NAMES[name]).detach().cpu().numpy() for name in NAMES})
'''

TRAIN = '''
import json
import os
import random
import types
import argparse
import torch
from gaussian_renderer import render
from scene import GaussianModel, Scene@DEFORM_IMPORT@
from arguments import ModelParams, OptimizationParams
@SPARSE@
def training(dataset, opt, pipe, checkpoint_iterations):
    os.makedirs(dataset.model_path, exist_ok=True)
    gaussians = GaussianModel(dataset.sh_degree)@DEFORM_MADE@
    scene = Scene(dataset, gaussians)
    gaussians.training_setup(opt)
    background = torch.zeros(3, device="cuda")
    iter_start, iter_end = torch.cuda.Event(True), torch.cuda.Event(True)
@FILTER_LINE@
    losses, counts = [], []
    for iteration in range(1, 1 + opt.iterations):
        iter_start.record()
@EARLY_RATE@
        viewpoint_cam = random.choice(scene.getTrainCameras())
        @DELTAS@drawn = render(viewpoint_cam, gaussians, pipe, background@ARGUMENTS@)
        radii = drawn["radii"]
        loss = (drawn["render"] - viewpoint_cam.original_image.cuda()).abs().mean()
        loss.backward()
        iter_end.record()
        losses.append(loss.item())
        counts.append(gaussians.get_xyz.shape[0])
        with torch.no_grad():
            # Densification
            if opt.densify_until_iter > iteration:
                gaussians.add_densification_stats(drawn["@POINTS@"], drawn["visibility_filter"])
                if iteration > opt.densify_from_iter and iteration % opt.densification_interval == 0:
                    gaussians.densify_and_prune(opt.densify_grad_threshold, 0.005, scene.cameras_extent, None@RADII_VALUE@)
@REFILTER@
                if iteration % opt.opacity_reset_interval == 0:
                    gaussians.reset_opacity()

            # Optimizer step
            if opt.iterations > iteration:
@STEP@
    scene.save(opt.iterations)
    with open(os.path.join(dataset.model_path, "losses.json"), "w") as file:
        json.dump({"losses": losses, "counts": counts, "seconds": iter_start.elapsed_time(iter_end)}, file)

if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    model_options, opt_options = ModelParams(parser), OptimizationParams(parser)
    args = parser.parse_args()
    random.seed(0)
    torch.manual_seed(0)
    torch.cuda.set_device("cuda:0")
    training(model_options.extract(args), opt_options.extract(args), types.SimpleNamespace(debug=False), [])
'''

RENDER = '''
import json
import os
import argparse
import torch
from scene import Scene@DEFORM_IMPORT@
from gaussian_renderer import render
from arguments import ModelParams
from gaussian_renderer import GaussianModel

if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    dataset = ModelParams(parser).extract(parser.parse_args())
    with torch.no_grad():
        gaussians = GaussianModel(dataset.sh_degree)
        scene = Scene(dataset, gaussians, load_iteration=1, shuffle=False)
@FILTER_LOADED@@DEFORM_LOADED@
        image = render(scene.getTrainCameras()[0], gaussians, None, torch.zeros(3, device="cuda")@ARGUMENTS@)["render"]
        torch.save(image.cpu(), os.path.join(dataset.model_path, "render.pt"))
'''

DEFORM_MODEL = '''

class DeformModel:
    """All Gaussians slide by one vector times the time."""

    def __init__(self):
        self.shift = torch.nn.Parameter(torch.full((3,), 0.01).cuda())
        self.optimizer = torch.optim.Adam([self.shift], lr=1e-3)

    def step(self, xyz, time):
        return self.shift * time.reshape(-1, 1).expand(xyz.shape[0], 1), 0.0, 0.0
'''

STEP = ["gaussians.optimizer.step()", "gaussians.optimizer.zero_grad(set_to_none = True)"]


def lines(depth, *texts):
    return "\n".join(" " * depth + text for text in texts)


def parts(layout):
    """Placeholder → text, for the places in which layouts differ."""
    mip, drop, late = layout in ("mip", "gof"), layout == "drop", layout == "3dgs-2024-10"
    deform = layout.startswith("deform")
    images = "rendered_image, radii, depth_image" if layout.startswith("3dgs-2024") else "rendered_image, radii"
    found = dict.fromkeys(
        "SIGNATURE SETTINGS FILTERED DROPOUT MIP_PROPERTIES MIP_START MIP_PRUNE MIP_STATS RADII_PRUNE RADII_CLONE "
        "RADII_SPLIT RADII_SET RADII_UNSET RADII RADII_VALUE ABSOLUTE ABSOLUTE_VALUES SPARSE FILTER_LINE FILTER_LOADED "
        "ARGUMENTS REFILTER MOVED TURNED STRETCHED DENSIFY DENSIFY_POINTS DENSIFY_RESULT DEFORM_MODEL DEFORM_IMPORT "
        "DEFORM_MADE DEFORM_LOADED DELTAS".split(), "")
    found.update(RESULT=images, POINTS="viewspace_points", EARLY_RATE=lines(8, "gaussians.update_learning_rate(iteration)"))
    found.update(SEEN="radii > 0" if layout in ("3dgs-2023", "mip", "deform", "deform-paper", "absgs", "2dgs", "gof") else "(radii > 0).nonzero()",
                 UNTIL="10_000" if drop else "15_000", THRESHOLD="0.0005" if drop else "0.0002",
                 STEP=lines(16, *STEP))
    if layout.startswith("3dgs-2024"):
        found["SIGNATURE"] = ", separate_sh=False, use_trained_exp=False" if late else ", use_trained_exp=False"
        found["SETTINGS"] = ", antialiasing=False"
        found["SPARSE"] = "exposure_optimizer = None" + ("\nSPARSE_ADAM_AVAILABLE = False" if late else "")
    if late:
        found["STEP"] = lines(16, "if False:", *["    " + s for s in ("visible = radii > 0",
                              "gaussians.optimizer.step(visible, radii.shape[0])", STEP[1])], "else:",
                              *["    " + s for s in STEP])
        found.update(RADII=", radii", RADII_VALUE=", radii", RADII_SET=lines(8, "self.tmp_radii = radii"),
                     RADII_UNSET=lines(8, "self.tmp_radii = None"),
                     RADII_PRUNE=lines(8, "self.tmp_radii = self.tmp_radii[~mask]", ""),
                     RADII_CLONE=lines(8, "self.tmp_radii = torch.cat([self.tmp_radii, self.tmp_radii[mask]])"),
                     RADII_SPLIT=lines(8, "self.tmp_radii = torch.cat([self.tmp_radii, self.tmp_radii[mask].repeat(N)])"))
    if mip:
        found.update(
            SIGNATURE=", kernel_size, subpixel_offset=None", ARGUMENTS=", kernel_size=dataset.kernel_size",
            SETTINGS=", kernel_size=kernel_size, subpixel_offset=torch.zeros(cam.height, cam.width, 2)",
            FILTERED="_with_3D_filter", ABSOLUTE="grads_abs, grad_abs_threshold, ",
            ABSOLUTE_VALUES="self.xyz_gradient_accum_abs, 9e9, ",
            MIP_PROPERTIES="""
    get_scaling_with_3D_filter = property(lambda self: torch.sqrt(self.get_scaling ** 2 + self.filter_3D ** 2))
    get_opacity_with_3D_filter = property(lambda self: self.get_opacity * (1 - self.filter_3D))

    def compute_3D_filter(self, cameras):
        self.filter_3D = torch.full((self.get_xyz.shape[0], 1), 0.01, device="cuda")
""",
            MIP_START=lines(8, 'self.xyz_gradient_accum_abs = torch.zeros((n, 1), device="cuda")', ""),
            MIP_PRUNE=lines(8, "self.xyz_gradient_accum_abs = self.xyz_gradient_accum_abs[~mask]", ""),
            MIP_STATS=lines(8, "self.xyz_gradient_accum_abs[seen] += torch.norm("
                               "on_screen.grad[seen, 2:], dim=-1, keepdim=True)"),
            FILTER_LINE=lines(4, "gaussians.compute_3D_filter(cameras=scene.getTrainCameras())"),
            FILTER_LOADED=lines(8, "gaussians.compute_3D_filter(cameras=scene.getTrainCameras())"),
            REFILTER=lines(20, "gaussians.compute_3D_filter(cameras=scene.getTrainCameras())"))
    if deform:
        found.update(
            SIGNATURE=", d_xyz, d_rotation, d_scaling, is_6dof=False", RESULT="rendered_image, radii, depth",
            MOVED=" + d_xyz", TURNED=" + d_rotation", STRETCHED=" + d_scaling", DEFORM_MODEL=DEFORM_MODEL, DEFORM_IMPORT=", DeformModel",
            DEFORM_MADE="\n" + lines(4, "deform = DeformModel()"),
            DEFORM_LOADED="\n" + lines(8, "deform = DeformModel()",
                                "d_xyz, d_rotation, d_scaling = deform.step(gaussians.get_xyz, scene.getTrainCameras()[0].fid)"),
            DELTAS=lines(8, "d_xyz, d_rotation, d_scaling = 0.0, 0.0, 0.0", "if iteration >= opt.warm_up:",
                         "    d_xyz, d_rotation, d_scaling = deform.step(gaussians.get_xyz.detach(), viewpoint_cam.fid)",
                         "").lstrip(" "),
            ARGUMENTS=", d_xyz, d_rotation, d_scaling, dataset.is_6dof", EARLY_RATE="",
            STEP=lines(16, STEP[0], "gaussians.update_learning_rate(iteration)", "deform.optimizer.step()", STEP[1],
                       "deform.optimizer.zero_grad()"))
    if layout == "deform":
        found.update(
            DENSIFY=" means2D_densify=on_screen_too,",
            DENSIFY_POINTS="\n" + lines(4, 'on_screen_too = torch.zeros_like(on_screen, requires_grad=True, device="cuda") * 1.0',
                                 "if torch.is_grad_enabled():", "    on_screen_too.retain_grad()"),
            DENSIFY_RESULT=' "viewspace_points_densify": on_screen_too,', POINTS="viewspace_points_densify",
            THRESHOLD="0.0007")
    if drop:
        found.update(SIGNATURE=", is_train=False, iteration=None", ARGUMENTS=", is_train=True, iteration=iteration",
                     DROPOUT=lines(4, "if is_train:", "    drop_rate = 0.2 * (iteration / 10000)",
                                   '    opacity = opacity * torch.nn.Dropout(drop_rate)(torch.ones_like(opacity))'))
    return found


#: Changes like those of forks of 3DGS at the places that its recipe edits: name → [(file, what, by)]. Each change alone
#: makes the recipe inapplicable.
FORKS = {
    "pixel-gs": [
        # Densification statistics weighted by the pixels that a Gaussian covers.
        ("scene/gaussian_model.py", "def add_densification_stats(self, on_screen, seen):",
         "def add_densification_stats(self, on_screen, seen, covered):"),
        ("train.py", 'drawn["visibility_filter"])', 'drawn["visibility_filter"], drawn["covered"])'),
    ],
    "deformable-3dgs": [
        # No checkpoints, Gaussians moved by a net, and a depth map beside the image.
        ("train.py", "def training(dataset, opt, pipe, checkpoint_iterations):", "def training(dataset, opt, pipe):"),
        ("gaussian_renderer/__init__.py", "def render(cam, pc, pipe, bg_color):",
         "def render(cam, pc, pipe, bg_color, moved, turned, stretched):"),
        ("gaussian_renderer/__init__.py", "means2D=on_screen,", "means2D=on_screen, means2D_densify=on_screen_too,"),
        ("gaussian_renderer/__init__.py", "rendered_image, radii = rasterizer(", "rendered_image, radii, depth = rasterizer("),
    ],
    "absgs": [
        # A third output of the rasterizer, and a second threshold in the middle of the arguments.
        ("gaussian_renderer/__init__.py", "rendered_image, radii = rasterizer(", "rendered_image, radii, weights = rasterizer("),
        ("scene/gaussian_model.py", "def densify_and_prune(self, max_grad, min_opacity, extent, max_screen_size):",
         "def densify_and_prune(self, max_grad, max_grad_abs, min_opacity, extent, max_screen_size):"),
        ("train.py", "gaussians.densify_and_prune(opt.densify_grad_threshold, 0.005,",
         "gaussians.densify_and_prune(opt.densify_grad_threshold, opt.densify_abs_threshold, 0.005,"),
    ],
}


#: Differences of AbsGS from 3DGS of 2023: [(file, what, by)].
ABSGS = [
    ("arguments/__init__.py", "        self.offer(parser, \"Optimization Parameters\")", """        self.densify_grad_abs_threshold, self.percent_dense = 0.0004, 0.001
        self.opacity_reduce_interval, self.use_prune_weight = 25, 0
        self.offer(parser, "Optimization Parameters")"""),
    ("gaussian_renderer/__init__.py", "from diff_gaussian_rasterization import", "from diff_gaussian_rasterization_abs import"),
    ("gaussian_renderer/__init__.py", "torch.zeros_like(pc.get_xyz, requires_grad=True, device=\"cuda\") * 1.0",
     "torch.zeros((pc.get_xyz.shape[0], 4), requires_grad=True, device=\"cuda\") * 1.0"),
    ("gaussian_renderer/__init__.py", "rendered_image, radii = rasterizer(", "rendered_image, radii, gs_w = rasterizer("),
    ("gaussian_renderer/__init__.py", "\"visibility_filter\":", "\"gs_w\": gs_w, \"visibility_filter\":"),
    ("scene/gaussian_model.py", "self.percent_dense = 0.01", "self.percent_dense = opt.percent_dense\n        self.max_weight = torch.zeros(self.get_xyz.shape[0])"),
    ("scene/gaussian_model.py", "        self.denom = torch.zeros((n, 1), device=\"cuda\")", """        self.denom = torch.zeros((n, 1), device="cuda")
        self.xyz_gradient_accum_abs = torch.zeros((n, 1), device="cuda")"""),
    ("scene/gaussian_model.py", "        self.denom = self.denom[~mask]", """        self.denom = self.denom[~mask]
        self.xyz_gradient_accum_abs = self.xyz_gradient_accum_abs[~mask]
        self.max_weight = self.max_weight[~mask]"""),
    ("scene/gaussian_model.py", "        self.change(grown)", """        self.change(grown)
        self.max_weight = torch.cat([self.max_weight, torch.zeros(len(rows["xyz"]))])"""),
    ("scene/gaussian_model.py", "        self.denom[seen] += 1.0", """        self.xyz_gradient_accum_abs[seen] += torch.norm(on_screen.grad[seen, 2:], dim=-1, keepdim=True)
        self.denom[seen] += 1.0"""),
    ("scene/gaussian_model.py", "def densify_and_prune(self, max_grad, min_opacity,", "def densify_and_prune(self, max_grad, max_grad_abs, min_opacity,"),
    ("scene/gaussian_model.py", "self.densify_and_split(grads, max_grad, extent)",
     "self.densify_and_split(grads_abs, max_grad_abs, extent)"),
    ("scene/gaussian_model.py", "        grads = torch.nan_to_num(self.xyz_gradient_accum / self.denom)",
     """        grads = torch.nan_to_num(self.xyz_gradient_accum / self.denom)
        grads_abs = torch.nan_to_num(self.xyz_gradient_accum_abs / self.denom)"""),
    ("scene/gaussian_model.py", "    def reset_opacity(self):", """    def reduce_opacity(self):
        high = torch.minimum(self._opacity.detach(), torch.full_like(self._opacity, 1.39))
        self.change(lambda name, value, moment=False: value if name != "opacity" else (torch.zeros_like(high) if moment else high))

    def reset_opacity(self):"""),
    ("train.py", "densify_and_prune(opt.densify_grad_threshold, 0.005,",
     "densify_and_prune(opt.densify_grad_threshold, opt.densify_grad_abs_threshold, 0.005,"),
    ("train.py", "                if iteration % opt.opacity_reset_interval == 0:", """                seen = drawn["visibility_filter"]
                if len(drawn["gs_w"]) == len(gaussians.max_weight):
                    gaussians.max_weight[seen] = torch.max(gaussians.max_weight[seen], drawn["gs_w"][seen])
                if iteration % opt.opacity_reduce_interval == 0:
                    gaussians.reduce_opacity()
                if iteration % opt.opacity_reset_interval == 0:"""),
]


#: Differences of 2D Gaussian Splatting: surfels with two scales, its own rasterizer, maps beside the image.
SURFELS = [
    ("gaussian_renderer/__init__.py", "from diff_gaussian_rasterization import", "from diff_surfel_rasterization import"),
    ("gaussian_renderer/__init__.py", "rendered_image, radii = rasterizer(", "rendered_image, radii, allmap = rasterizer("),
    ("gaussian_renderer/__init__.py", "\"visibility_filter\":", "\"rend_normal\": allmap[2:5], \"depth\": torch.nan_to_num(allmap[:1] / allmap[1:2], 0, 0), \"visibility_filter\":"),
    ("scene/gaussian_model.py", "torch.log(distance)[:, None].repeat(1, 3)", "torch.log(distance)[:, None].repeat(1, 2)"),
    ("scene/gaussian_model.py", "torch.normal(torch.zeros_like(rows[\"xyz\"]), torch.exp(rows[\"scaling\"]))",
     "torch.nn.functional.pad(torch.normal(torch.zeros_like(rows[\"scaling\"]), torch.exp(rows[\"scaling\"])), (0, 1))"),
    ("train.py", "abs().mean()", "abs().mean() + 0.01 * (1 - drawn[\"rend_normal\"].pow(2).sum(dim=0)).mean() + 0.0 * drawn[\"depth\"].mean()"),
    ("scene/__init__.py", "        self.centre =", """        self.FoVx, self.FoVy = 2 * math.atan(self.tanfovx), 2 * math.atan(self.tanfovy)
        self.world_view_transform, self.full_proj_transform = self.view, self.full
        self.camera_center = self.centre ="""),
]


_CAMERA = SURFELS[-1]
#: Differences of Gaussian Opacity Fields from Mip-Splatting: an image of nine channels, and the appearance of photos.
OPACITY_FIELDS = [
    _CAMERA,
    ("arguments/__init__.py", "self.kernel_size = 0.1", "self.kernel_size, self.use_decoupled_appearance = 0.1, 1"),
    ("train.py", "def training(", """def L1_loss_appearance(image, truth, gaussians, index, return_transformed_image=False):
    assert image.shape == truth.shape == (3, 32, 32) and return_transformed_image
    return image * gaussians.get_xyz.new_tensor([1.0, 1.0, 1.0 - 0.001 * index]).reshape(3, 1, 1)

def training("""),
    ("train.py", "    scene = Scene(dataset, gaussians)\n", """    scene = Scene(dataset, gaussians)
    for index, camera in enumerate(scene.getTrainCameras()):
        camera.idx = index
"""),
    ("gaussian_renderer/__init__.py", "means2D=on_screen,", "means2D=on_screen, view2gaussian_precomp=None,"),
    ("train.py", "(drawn[\"render\"] - viewpoint_cam.original_image.cuda())",
     "0.001 * (1 - drawn[\"render\"][7]).mean() + (drawn[\"render\"][:3] - viewpoint_cam.original_image.cuda())"),
]


#: Differences of PGSR from 3DGS of 2023: planes, absolute gradients, its own trim, exposures, a cap on Gaussians.
PLANES = [
    ("arguments/__init__.py", "        self.offer(parser, \"Optimization Parameters\")", """        self.densify_abs_grad_threshold, self.percent_dense, self.max_all_points = 0.0008, 0.001, 6000
        self.use_multi_view_trim, self.planes_from, self.exposure_compensation = 1, 30, 1
        self.offer(parser, "Optimization Parameters")"""),
    ("gaussian_renderer/__init__.py", "from diff_gaussian_rasterization import GaussianRasterizer, GaussianRasterizationSettings",
     """from diff_plane_rasterization import GaussianRasterizationSettings as PlaneGaussianRasterizationSettings
from diff_plane_rasterization import GaussianRasterizer as PlaneGaussianRasterizer"""),
    ("gaussian_renderer/__init__.py", "def render(cam, pc, pipe, bg_color):",
     "def render(cam, pc, pipe, bg_color, app_model=None, return_plane=True, return_depth_normal=True):"),
    ("gaussian_renderer/__init__.py", "    view = GaussianRasterizationSettings(", """    on_screen_abs = torch.zeros_like(on_screen, requires_grad=True) * 1.0
    if torch.is_grad_enabled():
        on_screen_abs.retain_grad()
    normals = pc.get_normal(cam) @ cam.view[:3, :3]
    distances = ((pc.get_xyz @ cam.view[:3, :3] + cam.view[3, :3]) * normals).sum(dim=1, keepdim=True).abs()
    planes = torch.cat([normals, torch.ones_like(distances), distances], dim=1)
    view = PlaneGaussianRasterizationSettings("""),
    ("gaussian_renderer/__init__.py", "prefiltered=False,", "prefiltered=False, render_geo=return_plane,"),
    ("gaussian_renderer/__init__.py", "rasterizer = GaussianRasterizer(view)", "rasterizer = PlaneGaussianRasterizer(raster_settings=view)"),
    ("gaussian_renderer/__init__.py", "rendered_image, radii = rasterizer(", "rendered_image, radii, observed, maps, depth = rasterizer("),
    ("gaussian_renderer/__init__.py", "means2D=on_screen,", "means2D=on_screen, means2D_abs=on_screen_abs, all_map=planes,"),
    ("gaussian_renderer/__init__.py", "\"visibility_filter\":", "\"viewspace_points_abs\": on_screen_abs, \"out_observe\": observed, \"normals\": maps[:3], \"plane_depth\": depth, **({} if app_model is None else {\"app_image\": rendered_image + app_model.shift}), \"visibility_filter\":"),
    ("scene/gaussian_model.py", "from simple_knn._C import distCUDA2", """from simple_knn._C import distCUDA2
from pytorch3d.transforms import quaternion_to_matrix"""),
    ("scene/gaussian_model.py", "    def create(self, points):", """    def get_normal(self, cam):
        shortest = self.get_scaling.min(dim=-1)[1][:, None, None].expand(-1, 3, -1)
        normals = quaternion_to_matrix(self.get_rotation).gather(2, shortest).squeeze(2)
        return torch.where(((cam.centre - self._xyz) * normals).sum(dim=1, keepdim=True) < 0, -normals, normals)

    def create(self, points):"""),
    ("scene/gaussian_model.py", "self.percent_dense = 0.01", """self.percent_dense, self.max_all_points = opt.percent_dense, opt.max_all_points
        self.abs_split_radii2D_threshold, self.max_abs_split_points = 20, 50000"""),
    ("scene/gaussian_model.py", "        self.denom = torch.zeros((n, 1), device=\"cuda\")", """        self.denom = torch.zeros((n, 1), device="cuda")
        self.denom_abs = torch.zeros((n, 1), device="cuda")
        self.xyz_gradient_accum_abs = torch.zeros((n, 1), device="cuda")"""),
    ("scene/gaussian_model.py", "        self.denom = self.denom[~mask]", """        self.denom = self.denom[~mask]
        self.denom_abs = self.denom_abs[~mask]
        self.xyz_gradient_accum_abs = self.xyz_gradient_accum_abs[~mask]"""),
    ("scene/gaussian_model.py", "    def add_densification_stats(self, on_screen, seen):", "    def add_densification_stats(self, on_screen, on_screen_abs, seen):"),
    ("scene/gaussian_model.py", "        self.denom[seen] += 1.0", """        self.xyz_gradient_accum_abs[seen] += torch.norm(on_screen_abs.grad[seen, :2], dim=-1, keepdim=True)
        self.denom_abs[seen] += 1.0
        self.denom[seen] += 1.0"""),
    ("scene/gaussian_model.py", "def densify_and_split(self, grads, grad_threshold, scene_extent, N=2):",
     "def densify_and_split(self, grads, grad_threshold, grads_abs, grad_abs_threshold, scene_extent, max_radii2D, N=2):"),
    ("scene/gaussian_model.py", "        mask = mask >= grad_threshold\n", """        mask = mask >= grad_threshold
        if int(mask.sum()) + n > self.max_all_points:
            mask = torch.zeros_like(mask)
        mask[:grads.shape[0]] |= (grads_abs.reshape(-1) >= grad_abs_threshold) & (max_radii2D.reshape(-1) > self.abs_split_radii2D_threshold)
"""),
    ("scene/gaussian_model.py", "def densify_and_prune(self, max_grad, min_opacity,", "def densify_and_prune(self, max_grad, abs_max_grad, min_opacity,"),
    ("scene/gaussian_model.py", "self.densify_and_split(grads, max_grad, extent)",
     "self.densify_and_split(grads, max_grad, grads_abs, abs_max_grad, extent, max_radii2D)"),
    ("scene/gaussian_model.py", "        grads = torch.nan_to_num(self.xyz_gradient_accum / self.denom)", """        grads = torch.nan_to_num(self.xyz_gradient_accum / self.denom)
        grads_abs, max_radii2D = torch.nan_to_num(self.xyz_gradient_accum_abs / self.denom_abs), self.max_radii2D.clone()"""),
    ("scene/__init__.py", "class Camera:", "from scene.cameras import Photo\n\n\nclass Camera(Photo):"),
    ("scene/__init__.py", "self.original_image =", "self._photo ="),
    ("train.py", "    iter_start, iter_end =", """    app_model = types.SimpleNamespace(shift=torch.zeros((), requires_grad=True))
    app_model.optimizer = torch.optim.Adam([app_model.shift], lr=1e-3)
    iter_start, iter_end ="""),
    ("train.py", "gaussians, pipe, background)\n", "gaussians, pipe, background, app_model=app_model, return_plane=iteration > opt.planes_from)\n"),
    ("train.py", "loss = (drawn[\"render\"] -", "loss = 0.01 * (1 - drawn[\"normals\"].pow(2).sum(dim=0)).mean() + (drawn[\"app_image\"] -"),
    ("train.py", "viewpoint_cam.original_image.cuda()", "viewpoint_cam.get_image()[0]"),
    ("train.py", "drawn[\"viewspace_points\"], drawn", "drawn[\"viewspace_points\"], drawn[\"viewspace_points_abs\"], drawn"),
    ("train.py", "densify_and_prune(opt.densify_grad_threshold, 0.005,",
     "densify_and_prune(opt.densify_grad_threshold, opt.densify_abs_grad_threshold, 0.005,"),
    ("train.py", "                if iteration % opt.opacity_reset_interval == 0:", """                mask = (drawn["out_observe"] > 0) & drawn["visibility_filter"]
                if len(mask) == len(gaussians.max_radii2D):
                    gaussians.max_radii2D[mask] = torch.max(gaussians.max_radii2D[mask], radii[mask].float())
            if opt.use_multi_view_trim and iteration % 35 == 0 and iteration < opt.densify_until_iter:
                observed = sum((render(view, gaussians, pipe, background)["out_observe"] > 0).int() for view in scene.getTrainCameras())
                gaussians.prune_points(observed < 2)
            if iteration < opt.densify_until_iter:
                if iteration % opt.opacity_reset_interval == 0:"""),
    ("train.py", "gaussians.optimizer.step()", "gaussians.optimizer.step()\n                app_model.optimizer.step()\n                app_model.optimizer.zero_grad()"),
]
PLANES_CAMERAS = """
class Photo:
    def get_image(self):
        return self._photo.cuda(), self._photo.mean(dim=0, keepdim=True).cuda()
"""
PLANES_READERS = """
def focals(model, params, height):
    if model == "SIMPLE_PINHOLE":
        focal_length_x = params[0]
        FovY = focal2fov(focal_length_x, height)
    else:
        focal_length_x, focal_length_y = params[:2]
        FovY = focal2fov(focal_length_y, height)
    return focal_length_x, focal_length_y, FovY


def focal2fov(focal, pixels):
    return pixels / focal
"""


def change(folder, changes):
    for file, what, by in changes:
        text = (folder / file).read_text(encoding="utf-8")
        assert text.count(what) == 1, (file, what)
        (folder / file).write_text(text.replace(what, by), encoding="utf-8")


def write_fork(folder, name, only=None):
    """Writes a fork of 3DGS of 2023, with all its changes or only change number `only`."""
    folder = write_host(folder, "3dgs-2023")
    change(folder, FORKS[name] if only is None else [FORKS[name][only]])
    return folder


def write_host(folder, layout):
    folder = pathlib.Path(folder)
    files = {"arguments/__init__.py": ARGUMENTS, "gaussian_renderer/__init__.py": RENDERER + "\nfrom scene.gaussian_model import GaussianModel",
             "scene/gaussian_model.py": MODEL, "scene/__init__.py": SCENE, "train.py": TRAIN, "render.py": RENDER}
    found = parts(layout)
    for name, text in files.items():
        # Gaussians are only dropped in training.
        here = dict(found, ARGUMENTS="") if name == "render.py" and layout == "drop" else found
        for key in sorted(here, key=len, reverse=True):
            text = text.replace("@%s@" % key, here[key])
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text.rstrip("\n"), encoding="utf-8")
    change(folder, {"absgs": ABSGS, "2dgs": SURFELS, "gof": OPACITY_FIELDS, "pgsr": PLANES}.get(layout, []))
    if layout == "pgsr":
        (folder / "scene/dataset_readers.py").write_text(PLANES_READERS, encoding="utf-8")
        (folder / "scene/cameras.py").write_text(PLANES_CAMERAS, encoding="utf-8")
        (folder / "scripts").mkdir()
        (folder / "scripts/render_tnt.py").write_text((folder / "render.py").read_text(encoding="utf-8"), encoding="utf-8")
    return folder
