# SPDX-License-Identifier: Apache-2.0
"""Miniature checkouts with the names and pitfalls of Scaffold-GS and Octree-GS, written for the tests."""

import pathlib

import miniature_host

#: layout → recipe that fits it
RECIPES = {"scaffold": "scaffold-gs", "octree": "octree-gs"}

ARGUMENTS = miniature_host.ARGUMENTS[:miniature_host.ARGUMENTS.index("class ModelParams")] + '''
class ModelParams(Options):
    def __init__(self, parser):
        self.model_path = ""
        self.update_ratio, self.white_background = 0.2, 0
        self.offer(parser, "model")


class OptimizationParams(Options):
    def __init__(self, parser):
        self.iterations, self.start_stat = 30_000, 500
        self.update_from, self.update_interval, self.update_until = 1500, 100, 15_000
        self.min_opacity, self.success_threshold, self.densify_grad_threshold = 0.005, 0.8, 0.0002
        self.offer(parser, "Optimization Parameters")
'''

#: The file of the host's rasterizer whose near plane its users are told to edit for very large scenes.
NEAR_PLANE = "submodules/diff-gaussian-rasterization/cuda_rasterizer/auxiliary.h"

RENDERER = '''
import torch
from diff_gaussian_rasterization import GaussianRasterizer, GaussianRasterizationSettings

def settings_of(cam, bg_color):
    return GaussianRasterizationSettings(
        image_height=cam.height, image_width=cam.width, tanfovx=cam.tanfovx, tanfovy=cam.tanfovy, bg=bg_color,
        scale_modifier=1.0, viewmatrix=cam.view, projmatrix=cam.full, sh_degree=1, campos=cam.centre, prefiltered=False,
        debug=False)

def render(cam, pc, pipe, bg_color, scaling_modifier=1.0, visible_mask=None, retain_grad=False):
    xyz, color, opacity, scaling, rot, all_opacity, mask = pc.decode(cam, visible_mask)
    on_screen = torch.zeros_like(xyz, requires_grad=True, device="cuda") + 0
    if retain_grad:
        on_screen.retain_grad()
    rasterizer = GaussianRasterizer(raster_settings=settings_of(cam, bg_color))

    rendered_image, radii = rasterizer(
        means3D = xyz,
        means2D = on_screen,
        shs = None,
        colors_precomp = color,
        opacities = opacity,
        scales = scaling,
        rotations = rot,
        cov3D_precomp = None)
    return {"render": rendered_image, "viewspace_points": on_screen, "visibility_filter": radii > 0, "radii": radii,
            "selection_mask": mask, "neural_opacity": all_opacity, "scaling": scaling}

def prefilter_voxel(cam, pc, pipe, bg_color):
    rasterizer = GaussianRasterizer(raster_settings=settings_of(cam, bg_color))
    use = @USE@
    radii_pure = rasterizer.visible_filter(means3D = pc.get_anchor[use],
        scales = pc.get_scaling[use][:,:3],
        rotations = pc.get_rotation[use],
        cov3D_precomp = None)
    seen = use.clone()
    seen[use] = radii_pure > 0
    return seen
'''

MODEL = '''
import torch
from torch_scatter import scatter_max
from scene.embedding import Embedding

NAMES = {"anchor": "_anchor", "offset": "_offset", "anchor_feat": "_anchor_feat", "scaling": "_scaling",
         "rotation": "_rotation", "mlp_opacity": "opacity_net", "mlp_cov": "cov_net", "mlp_color": "color_net"}
RATES = {"anchor": 0.0, "offset": 1e-2, "anchor_feat": 1e-2, "scaling": 7e-3, "rotation": 2e-3, "mlp_opacity": 2e-2,
         "mlp_cov": 4e-3, "mlp_color": 8e-3}
FEATURES = 4


class GaussianModel:
    def __init__(self):
        self.n_offsets, self.voxel_size, self.update_depth, self.spatial_lr_scale = 3, 0.1, 2, 2.0
@MADE@
    get_anchor = property(lambda self: self._anchor)
    get_scaling = property(lambda self: torch.exp(self._scaling))
    get_rotation = property(lambda self: torch.nn.functional.normalize(self._rotation))
@PROPERTIES@
    def create(self, points):
        cells = torch.unique(torch.round(points / self.voxel_size), dim=0)
        n, k = cells.shape[0], self.n_offsets
        generator = torch.Generator(device="cuda").manual_seed(1)
        random = lambda *shape: 0.5 * torch.randn(*shape, generator=generator)
        values = {"anchor": cells * self.voxel_size, "offset": random(n, k, 3), "anchor_feat": random(n, FEATURES),
                  "scaling": torch.full((n, 6), -1.5), "rotation": torch.tensor([[1.0, 0, 0, 0]]).repeat(n, 1),
                  "mlp_opacity": random(FEATURES + 3, k), "mlp_cov": random(FEATURES + 3, 7 * k),
                  "mlp_color": random(FEATURES + 3, 3 * k)}
        for name, value in values.items():
            setattr(self, NAMES[name], torch.nn.Parameter(value.float().cuda(), requires_grad=name != "rotation"))

    def decode(self, cam, seen):
        k = self.n_offsets
        anchor, scaling = self.get_anchor[seen], self.get_scaling[seen]
        towards = torch.nn.functional.normalize(anchor - cam.centre)
        known = torch.cat([self._anchor_feat[seen], towards], dim=1)
        opacity = torch.tanh(known @ self.opacity_net).reshape(-1, 1)
        mask = (opacity > 0).view(-1)
        color = torch.sigmoid(known @ self.color_net).reshape(-1, 3)[mask]
        shape = (known @ self.cov_net).reshape(-1, 7)[mask]
        scaling = scaling.repeat_interleave(k, dim=0)[mask]
        xyz = anchor.repeat_interleave(k, dim=0)[mask] + self._offset[seen].view(-1, 3)[mask] * scaling[:, :3]
        turned = torch.nn.functional.normalize(shape[:, 3:] + torch.tensor([1.0, 0, 0, 0]))
        return xyz, color, opacity[mask], scaling[:, 3:] * torch.sigmoid(shape[:, :3]), turned, opacity, mask

    def training_setup(self, opt):
        self.optimizer = torch.optim.Adam(
            [{"params": [getattr(self, NAMES[name])], "lr": RATES[name], "name": name} for name in NAMES], lr=0.0, eps=1e-15)
        n, k = self.get_anchor.shape[0], self.n_offsets
        self.opacity_accum, self.anchor_demon = torch.zeros(n, 1), torch.zeros(n, 1)
        self.offset_gradient_accum, self.offset_denom = torch.zeros(n * k, 1), torch.zeros(n * k, 1)

    def update_learning_rate(self, iteration):
        pass

    def training_statis(self, on_screen, opacity, update_filter, selection, seen):
        self.opacity_accum[seen] += opacity.detach().clamp_min(0).view(-1, self.n_offsets).sum(dim=1, keepdim=True)
        self.anchor_demon[seen] += 1
        slots = torch.nonzero(seen.repeat_interleave(self.n_offsets)).reshape(-1)[selection][update_filter]
        self.offset_gradient_accum[slots] += torch.norm(on_screen.grad[update_filter, :2], dim=-1, keepdim=True)
        self.offset_denom[slots] += 1

    def change(self, change):
        """Every parameter of anchors and its moments through `change`."""
        for group in self.optimizer.param_groups:
            if "mlp" in group["name"]:
                continue
            old = group["params"][0]
            state = self.optimizer.state.pop(old, None)
            new = torch.nn.Parameter(change(group["name"], old.detach(), False), requires_grad=old.requires_grad)
            if state is not None:
                for key in ("exp_avg", "exp_avg_sq"):
                    state[key] = change(group["name"], state[key], True)
                self.optimizer.state[new] = state
            group["params"][0] = new
            setattr(self, NAMES[group["name"]], new)

    def add(self, cells, size, feat@ADDED@):
        n = cells.shape[0]
        rows = {"anchor": cells * size, "offset": torch.zeros(n, self.n_offsets, 3), "anchor_feat": feat,
                "scaling": torch.full((n, 6), float(size)).log(), "rotation": torch.tensor([[1.0, 0, 0, 0]]).repeat(n, 1)}
        self.change(lambda name, value, moment: torch.cat([value, torch.zeros_like(rows[name]) if moment else rows[name]]))
        self.opacity_accum = torch.cat([self.opacity_accum, torch.zeros(n, 1)])
        self.anchor_demon = torch.cat([self.anchor_demon, torch.zeros(n, 1)])
@ADD_LEVEL@
    def grow_cells(self, candidate_mask, size@ADDED@):
        more = self.get_anchor.shape[0] * self.n_offsets - candidate_mask.shape[0]
        candidate_mask = torch.cat([candidate_mask, torch.zeros(more, dtype=torch.bool, device="cuda")])
        where = (self.get_anchor.unsqueeze(1) + self._offset * self.get_scaling[:, None, :3]).view(-1, 3)[candidate_mask]
        cells, parents = torch.unique(torch.round(where / size).int(), return_inverse=True, dim=0)
        if cells.shape[0] == 0:
            return
        taken = torch.round(self.get_anchor / size).int()
        free = ~(cells.unsqueeze(1) == taken).all(-1).any(-1)
        feat = self._anchor_feat.detach().repeat_interleave(self.n_offsets, dim=0)[candidate_mask]
        feat = scatter_max(feat, parents.unsqueeze(1).expand(-1, FEATURES), dim=0)[0]
        if free.any():
            self.add(cells[free], size, feat[free]@LEVEL_VALUE@)

@GROWING@
    def adjust_anchor(self, @ITERATION@check_interval=100, success_threshold=0.8, grad_threshold=0.0002, @RATIOS@min_opacity=0.005):
        grads = torch.nan_to_num(self.offset_gradient_accum / self.offset_denom).reshape(-1)
        offset_mask = (self.offset_denom > check_interval * success_threshold * 0.5).squeeze(dim=1)
        self.grow_slots(@ITERATION@grads, offset_mask, grad_threshold@RATIO_VALUES@)
        n, k = self.get_anchor.shape[0], self.n_offsets
        for name in ("offset_denom", "offset_gradient_accum"):
            sums = getattr(self, name).clone()
            sums[offset_mask] = 0
            setattr(self, name, torch.cat([sums, torch.zeros(n * k - sums.shape[0], 1)]))
        judged = (self.anchor_demon > check_interval * success_threshold).squeeze(dim=1)
        gone = (self.opacity_accum < min_opacity * self.anchor_demon).squeeze(dim=1) & judged
        self.opacity_accum[judged] = 0
        self.anchor_demon[judged] = 0
        self.change(lambda name, value, moment: value[~gone])
        self.opacity_accum, self.anchor_demon = self.opacity_accum[~gone], self.anchor_demon[~gone]
        self.offset_denom = self.offset_denom.view(n, k)[~gone].view(-1, 1)
        self.offset_gradient_accum = self.offset_gradient_accum.view(n, k)[~gone].view(-1, 1)
@PRUNE_LEVEL@'''

SCAFFOLD_GROWING = '''
    def grow_slots(self, grads, judged, least):
        for i in range(self.update_depth):
            cur_threshold = least * 2 ** i
            candidate_mask = (grads >= cur_threshold)
            candidate_mask = judged & candidate_mask & (torch.rand_like(grads) > 0.5 ** (i + 1))
            self.grow_cells(candidate_mask, self.voxel_size * (self.update_init_factor // 4 ** i))
'''

OCTREE_GROWING = '''
    def grow_slots(self, iteration, grads, judged, least, update_ratio, extra_ratio, extra_up):
        grads = grads * judged
        levels = self._level.reshape(-1).repeat_interleave(self.n_offsets)
        for cur_level in range(2):
            cur_threshold = least * self.fork ** (update_ratio * cur_level)
            ds_threshold = cur_threshold * self.fork ** update_ratio
            candidate_mask = (cur_threshold <= grads) & (grads < ds_threshold)
            candidate_ds_mask = (grads >= ds_threshold)
            self.extra += extra_up * int((grads >= cur_threshold * extra_ratio).sum())
            size = self.voxel_size / self.fork ** cur_level
            self.grow_cells(candidate_mask & (levels == cur_level), size, cur_level)
            if cur_level == 0:
                self.grow_cells(candidate_ds_mask & (levels == cur_level), size / self.fork, cur_level + 1)

    def set_anchor_mask(self, centre, iteration, resolution_scale):
        near = (self.get_anchor - centre).norm(dim=1) < 4.5
        self._anchor_mask = (self._level.reshape(-1) == 0) | near
'''

TRAIN = '''
import argparse
import json
import os
import random
import types
import torch
from gaussian_renderer import prefilter_voxel, render
from scene import Scene, GaussianModel
from arguments import ModelParams, OptimizationParams

def training(dataset, opt, pipe):
    os.makedirs(dataset.model_path, exist_ok=True)
    gaussians = GaussianModel()
    scene = Scene(dataset, gaussians)
    gaussians.training_setup(opt)
    iter_start, iter_end = torch.cuda.Event(True), torch.cuda.Event(True)
    losses, counts = [], []
    for iteration in range(1, 1 + opt.iterations):
        iter_start.record()
        gaussians.update_learning_rate(iteration)
        background = torch.zeros(3, device="cuda")
        viewpoint_cam = random.choice(scene.getTrainCameras())
@LEVELS@
        seen = prefilter_voxel(viewpoint_cam, gaussians, pipe, background)
        drawn = render(viewpoint_cam, gaussians, pipe, background, visible_mask=seen, retain_grad=iteration < opt.update_until)
        loss = (drawn["render"] - viewpoint_cam.original_image.cuda()).abs().mean() + 0.01 * drawn["scaling"].prod(dim=1).mean()
        loss.backward()
        iter_end.record()
        losses.append(loss.item())
        counts.append(gaussians.get_anchor.shape[0])
        with torch.no_grad():
            if opt.start_stat < iteration < opt.update_until:
                gaussians.training_statis(drawn["viewspace_points"], drawn["neural_opacity"], drawn["visibility_filter"],
                                          drawn["selection_mask"], seen)
                if iteration % opt.update_interval == 0 and opt.update_from < iteration:
                    gaussians.adjust_anchor(@ITERATION_GIVEN@check_interval=opt.update_interval, success_threshold=opt.success_threshold,
                                            grad_threshold=opt.densify_grad_threshold, @RATIOS_GIVEN@min_opacity=opt.min_opacity)
            elif iteration == opt.update_until:
                del gaussians.offset_gradient_accum, gaussians.offset_denom
            if iteration < opt.iterations:
                gaussians.optimizer.step()
                gaussians.optimizer.zero_grad(True)
    scene.save(opt.iterations)
    with open(os.path.join(dataset.model_path, "losses.json"), "w") as file:
        json.dump({"losses": losses, "counts": counts, "extra": getattr(gaussians, "extra", 0)}, file)

def draw_saved(dataset, saved):
    with torch.no_grad():
        gaussians = GaussianModel()
        scene = Scene(dataset, gaussians, load_iteration=saved, shuffle=False)
        background = torch.zeros(3, device="cuda")
        cam = scene.getTrainCameras()[0]
@LEVELS_OF_CAM@
        seen = prefilter_voxel(cam, gaussians, None, background)
        torch.save(render(cam, gaussians, None, background, visible_mask=seen)["render"].cpu(),
                   os.path.join(dataset.model_path, "trained.pt"))

if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    model_options, opt_options = ModelParams(parser), OptimizationParams(parser)
    args = parser.parse_args()
    random.seed(0)
    torch.manual_seed(0)
    training(model_options.extract(args), opt_options.extract(args), types.SimpleNamespace(debug=False))
    draw_saved(model_options.extract(args), 1)
'''

RENDER = '''
import argparse
import os
import torch
from scene import Scene
from gaussian_renderer import prefilter_voxel, render
from arguments import ModelParams
from gaussian_renderer import GaussianModel

if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    dataset = ModelParams(parser).extract(parser.parse_args())
    with torch.no_grad():
        gaussians = GaussianModel()
        scene = Scene(dataset, gaussians, load_iteration=1, shuffle=False)
        background = torch.zeros(3, device="cuda")
        cam = scene.getTrainCameras()[0]
@LEVELS_OF_CAM@
        seen = prefilter_voxel(cam, gaussians, None, background)
        torch.save(render(cam, gaussians, None, background, visible_mask=seen)["render"].cpu(),
                   os.path.join(dataset.model_path, "render.pt"))
'''

SCENE = miniature_host.SCENE.replace("@DEFORM_MODEL@", "").replace("self.centre = ", "self.resolution_scale = 1.0\n        self.camera_center = self.centre = ")


def parts(layout):
    """Placeholder → text, for the places in which layouts differ."""
    found = dict.fromkeys("USE MADE PROPERTIES ADDED ADD_LEVEL LEVEL_VALUE ITERATION RATIOS RATIO_VALUES PRUNE_LEVEL LEVELS "
                          "LEVELS_OF_CAM ITERATION_GIVEN RATIOS_GIVEN".split(), "")
    found.update(USE="torch.ones(pc.get_anchor.shape[0], dtype=torch.bool, device=\"cuda\")", GROWING=SCAFFOLD_GROWING,
                 MADE="        self.update_init_factor = 4\n")
    if layout == "octree":
        level = "gaussians.set_anchor_mask(%s.camera_center, %s, %s.resolution_scale)"
        found.update(
            USE="pc._anchor_mask", MADE="        self.fork, self.extra = 2, 0.0\n", GROWING=OCTREE_GROWING,
            PROPERTIES="    get_level = property(lambda self: self._level)\n"
                       "    _level = property(lambda self: self._rotation[:, 3:].detach())  # saved with it, and of no effect\n",
            ADDED=", level", ADD_LEVEL="        self._rotation.data[-n:, 3] = float(level)\n", LEVEL_VALUE=", level",
            ITERATION="iteration, ", RATIOS="update_ratio=0.5, extra_ratio=4.0, extra_up=0.25, ",
            RATIO_VALUES=", update_ratio, extra_ratio, extra_up",
            LEVELS="        " + level % ("viewpoint_cam", "iteration", "viewpoint_cam"),
            LEVELS_OF_CAM="        " + level % ("cam", "1", "cam"), ITERATION_GIVEN="iteration=iteration, ",
            RATIOS_GIVEN="update_ratio=dataset.update_ratio, extra_ratio=0.25, extra_up=0.01, ")
    return found


def write_host(folder, layout):
    folder = pathlib.Path(folder)
    files = {"arguments/__init__.py": ARGUMENTS,
             "gaussian_renderer/__init__.py": RENDERER + "\nfrom scene.gaussian_model import GaussianModel",
             "scene/gaussian_model.py": MODEL, "scene/__init__.py": SCENE, "scene/embedding.py": "class Embedding:\n    pass",
             "train.py": TRAIN, "render.py": RENDER, NEAR_PLANE: "\tif (p_view.z <= 0.2f)// ||\n\t{\n\t\treturn false;\n\t}"}
    found = parts(layout)
    for name, text in files.items():
        for key in sorted(found, key=len, reverse=True):
            text = text.replace("@%s@" % key, found[key])
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text.rstrip("\n"), encoding="utf-8")
    return folder
