# SPDX-License-Identifier: Apache-2.0
"""A miniature checkout of 3D Convex Splatting, written for the tests like miniature_host.py."""

import pathlib

import miniature_host

#: layout → recipe that fits it
RECIPES = {"convexes": "convex-splatting"}

ARGUMENTS = miniature_host.ARGUMENTS.replace("@UNTIL@", "9_000").replace("@THRESHOLD@", "1e-4")

RENDERER = '''
import torch
from diff_convex_rasterization import ConvexRasterizationSettings, ConvexRasterizer
from scene.convex_model import ConvexModel

def render(cam, pc, pipe, bg_color):
    count = pc.get_convex_points.shape[0]
    on_screen = torch.zeros((count, 3), requires_grad=True, device="cuda") * 1.0
    steepness = pc.get_sigma.clone()
    if torch.is_grad_enabled():
        on_screen.retain_grad()
        steepness.retain_grad()
    view = ConvexRasterizationSettings(
        image_height=cam.height, image_width=cam.width, tanfovx=cam.tanfovx, tanfovy=cam.tanfovy, bg=bg_color,
        scale_modifier=1.0, viewmatrix=cam.view, projmatrix=cam.full, sh_degree=1, campos=cam.centre, prefiltered=False,
        debug=False)
    rasterizer = ConvexRasterizer(raster_settings=view)
    rendered_image, radii, scaling, density_factor, allmap = rasterizer(convex_points=pc.get_convex_points.flatten(0),
        delta=torch.exp(pc._delta), sigma=steepness,
        num_points_per_convex=pc.sizes, cumsum_of_points_per_convex=torch.cumsum(pc.sizes, 0).int() - 6,
        number_of_points=count, shs=torch.cat([pc._features_dc, pc._features_rest], dim=1), colors_precomp=None,
        opacities=pc.get_opacity * torch.sigmoid(pc._mask), means2D=on_screen, scaling=torch.zeros(count),
        density_factor=torch.zeros(count))
    return {"render": rendered_image, "viewspace_points": on_screen, "viewspace_sigma": steepness,
            "visibility_filter": radii > 0, "radii": radii, "scaling": scaling, "density_factor": density_factor}
'''

MODEL = '''
import torch
from simple_knn._C import distCUDA2

NAMES = {"f_dc": "_features_dc", "f_rest": "_features_rest", "opacity": "_opacity", "convex_points": "_convex_points",
         "delta": "_delta", "sigma": "_sigma", "mask": "_mask"}
RATES = {"f_dc": 1e-2, "f_rest": 5e-4, "opacity": 2e-2, "convex_points": 3e-3, "delta": 5e-3, "sigma": 5e-3, "mask": 1e-2}
CORNERS = torch.tensor([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])


class ConvexModel:
    def __init__(self):
        self.nb_points = 6

    get_convex_points = property(lambda self: self._convex_points)
    get_sigma = property(lambda self: torch.exp(self._sigma))
    get_opacity = property(lambda self: torch.sigmoid(self._opacity))
    get_max_scaling = property(lambda self: self.max_scaling)
    sizes = property(lambda self: torch.full((self._convex_points.shape[0],), 6, dtype=torch.int32, device="cuda"))

    def create(self, points):
        n = points.shape[0]
        distance = torch.sqrt(distCUDA2(points.cuda()).clamp_min(1e-7))[:, None]
        values = {"f_dc": torch.zeros(n, 1, 3), "f_rest": torch.zeros(n, 3, 3), "opacity": torch.full((n, 1), -1.0),
                  "convex_points": points[:, None] + CORNERS * 1.2 * distance[:, None],
                  "delta": torch.log(0.05 / distance), "sigma": torch.full((n, 1), -2.0), "mask": torch.ones(n, 1)}
        for name, value in values.items():
            setattr(self, NAMES[name], torch.nn.Parameter(value.float().cuda()))

    def training_setup(self, opt):
        self.max_grad = opt.densify_grad_threshold
        self.optimizer = torch.optim.Adam(
            [{"params": [getattr(self, NAMES[name])], "lr": RATES[name], "name": name} for name in NAMES], lr=0.0, eps=1e-15)
        self.max_scaling = torch.zeros(self._opacity.shape[0], device="cuda")
        self.start_statistics()

    def start_statistics(self):
        n = self._opacity.shape[0]
        for name in ("convex_accumulation_gradient_accum", "sigma_accumulation_gradient_accum", "denom"):
            setattr(self, name, torch.zeros((n, 1), device="cuda"))
        self.max_radii2D = torch.zeros((n,), device="cuda")
        self.max_density_factor = torch.zeros((n,), device="cuda")

    def update_learning_rate(self, iteration):
        pass

    def change(self, change):
        """Every parameter and its moments through `change`."""
        for group in self.optimizer.param_groups:
            old = group["params"][0]
            state = self.optimizer.state.pop(old)
            new = torch.nn.Parameter(change(group["name"], old.detach(), False))
            for key in ("exp_avg", "exp_avg_sq"):
                state[key] = change(group["name"], state[key], True)
            self.optimizer.state[new] = state
            group["params"][0] = new
            setattr(self, NAMES[group["name"]], new)

    def prune_points(self, mask):
        self.change(lambda name, value, moment: value[~mask])
        for name in ("convex_accumulation_gradient_accum", "sigma_accumulation_gradient_accum", "denom", "max_radii2D",
                     "max_density_factor", "max_scaling"):
            setattr(self, name, getattr(self, name)[~mask])

    def densify_and_split_sigma_big(self, mask):
        count = int(mask.sum())
        if count == 0:
            return
        points = self._convex_points.detach()[mask]
        around = 0.6 * (points - points.mean(dim=1, keepdim=True))
        rows = {name: getattr(self, NAMES[name]).detach()[mask] for name in NAMES}
        rows = {name: value.repeat((6,) + (1,) * (value.dim() - 1)) for name, value in rows.items()}
        rows["convex_points"] = torch.cat([points[:, i:i + 1] + around for i in range(6)])
        rows["opacity"] = torch.logit(0.5 * torch.sigmoid(rows["opacity"]))
        self.change(lambda name, value, moment: torch.cat([value, torch.zeros_like(rows[name]) if moment else rows[name]]))
        self.start_statistics()
        self.max_scaling = torch.cat([self.max_scaling, torch.zeros(6 * count, device="cuda")])
        self.prune_points(torch.cat([mask, torch.zeros(6 * count, dtype=torch.bool, device="cuda")]))

    def faint(self, min_opacity, mask_threshold):
        return ((torch.sigmoid(self._mask) <= mask_threshold) | (self.get_opacity < min_opacity)).reshape(-1)

    def densify_and_prune(self, min_opacity, mask_threshold, extent, max_screen_size):
        mean = torch.nan_to_num(self.sigma_accumulation_gradient_accum / self.denom).reshape(-1)
        self.densify_and_split_sigma_big(mean >= self.max_grad)
        gone = self.faint(min_opacity, mask_threshold)
        if max_screen_size:
            gone |= self.max_scaling > max_screen_size * extent
        self.prune_points(gone)

    def only_prune(self, opacity_floor, mask_floor):
        self.prune_points(self.faint(opacity_floor, mask_floor))

    def add_densification_stats(self, on_screen, steepness, seen, scaling, density_factor):
        self.convex_accumulation_gradient_accum[seen] += torch.norm(on_screen.grad[seen, :2], dim=-1, keepdim=True)
        self.sigma_accumulation_gradient_accum[seen] += steepness.grad[seen]
        self.denom[seen] += 1.0
        self.max_scaling[seen] = scaling[seen]

    def reset_opacity(self, most):
        low = torch.logit(self.get_opacity.detach().clamp_max(most))
        self.change(lambda name, value, moment: value if name != "opacity" else (torch.zeros_like(low) if moment else low))
'''

SCENE = (miniature_host.SCENE.replace("@DEFORM_MODEL@", "").replace("scene.gaussian_model", "scene.convex_model")
         .replace("GaussianModel", "ConvexModel"))

TRAIN = '''
import argparse
import json
import os
import random
import types
import lpips
import matplotlib.pyplot as plt
import torch
from convex_renderer import render
from scene import Scene, ConvexModel
from arguments import ModelParams, OptimizationParams

def training(dataset, opt, pipe):
    os.makedirs(dataset.model_path, exist_ok=True)
    convexes = ConvexModel()
    scene = Scene(dataset, convexes)
    convexes.training_setup(opt)
    background = torch.zeros(3, device="cuda")
    iter_start, iter_end = torch.cuda.Event(True), torch.cuda.Event(True)
    losses, counts = [], []
    for iteration in range(1, 1 + opt.iterations):
        iter_start.record()
        convexes.update_learning_rate(iteration)
        viewpoint_cam = random.choice(scene.getTrainCameras())
        drawn = render(viewpoint_cam, convexes, pipe, background)
        loss = (drawn["render"] - viewpoint_cam.original_image.cuda()).abs().mean() + 0.0005 * torch.sigmoid(convexes._mask).mean()
        loss.backward()
        iter_end.record()
        losses.append(loss.item())
        counts.append(convexes.get_convex_points.shape[0])
        with torch.no_grad():
            if iteration < opt.densify_until_iter:
                convexes.add_densification_stats(drawn["viewspace_points"], drawn["viewspace_sigma"], drawn["visibility_filter"],
                                                 drawn["scaling"], drawn["density_factor"])
                due = iteration % opt.densification_interval == 0
                if due and opt.densify_from_iter < iteration:
                    size = 0.3 if iteration > opt.opacity_reset_interval else None
                    convexes.densify_and_prune(0.03, 0.02, scene.cameras_extent, size)
                if iteration % opt.opacity_reset_interval == 0:
                    convexes.reset_opacity(0.2)
            else:
                if iteration % 25 == 0:
                    convexes.only_prune(0.03, 0.02)
                if iteration % opt.opacity_reset_interval == 0 and iteration < opt.warm_up:
                    convexes.reset_opacity(0.2)

            if iteration < opt.iterations:
                convexes.optimizer.step()
                convexes.optimizer.zero_grad()
    scene.save(opt.iterations)
    with open(os.path.join(dataset.model_path, "losses.json"), "w") as file:
        json.dump({"losses": losses, "counts": counts}, file)

if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    model_options, opt_options = ModelParams(parser), OptimizationParams(parser)
    args = parser.parse_args()
    lpips_fn = lpips.LPIPS(net="vgg").cuda()
    random.seed(0)
    torch.manual_seed(0)
    training(model_options.extract(args), opt_options.extract(args), types.SimpleNamespace(debug=False))
'''

RENDER = '''
import argparse
import os
import torch
from scene import Scene
from convex_renderer import render
from arguments import ModelParams
from convex_renderer import ConvexModel

if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    dataset = ModelParams(parser).extract(parser.parse_args())
    with torch.no_grad():
        convexes = ConvexModel()
        scene = Scene(dataset, convexes, load_iteration=1, shuffle=False)
        image = render(scene.getTrainCameras()[0], convexes, None, torch.zeros(3, device="cuda"))["render"]
        torch.save(image.cpu(), os.path.join(dataset.model_path, "render.pt"))
'''


def write_host(folder, layout="convexes"):
    folder = pathlib.Path(folder)
    files = {"arguments/__init__.py": ARGUMENTS, "convex_renderer/__init__.py": RENDERER, "scene/convex_model.py": MODEL,
             "scene/__init__.py": SCENE, "train.py": TRAIN, "render.py": RENDER}
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text.rstrip("\n"), encoding="utf-8")
    return folder
