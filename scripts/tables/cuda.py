# SPDX-License-Identifier: Apache-2.0
"""Tables of docs/results/cuda.md: an NVIDIA GPU, and what the compiler reports."""
from tables.cells import difference, load, markdown


def gpu_compare():
    """The default beside 3DGS as published."""
    data = load("gpu_compare")
    rows = [["", "Gaussians", "training time", "PSNR", "SSIM", "LPIPS"]]
    for name, runs in data["scenes"].items():
        a, b = runs["baseline"], runs["boosted"]
        rows.append([f"{name}, {a['width']}×{a['height']}, published", f"{a['primitives']:,}", f"{a['train_seconds']:.1f} s",
                     f"{a['psnr']:.2f} dB", f"{a['ssim']:.4f}", f"{a['lpips']:.4f}"])
        rows.append([f"{name}, default", f"{b['primitives']:,} ({b['primitives'] / a['primitives']:.2f}×)",
                     f"{b['train_seconds']:.1f} s ({b['train_seconds'] / a['train_seconds']:.2f}×)",
                     *(f"{b[key]:.{digits}f} ({difference(b[key] - a[key], digits)})"
                       for key, digits in (("psnr", 2), ("ssim", 4), ("lpips", 4)))])
    run = next(iter(data["scenes"].values()))["boosted"]
    return f"{markdown(rows)}\n\n{data['device']}, one seed, {run['date'][:10]}: `{run['command']}`"


def gpu_backbones():
    """Other backbones on a GPU, beside their published runs where there are any."""
    data = load("gpu_backbones")
    rows = [["backbone", "scene", "rules", "PSNR", "SSIM", "LPIPS", "primitives", "time", "rendering"]]
    published = {(run["backbone"], run["scene"]): run["results"] for run in data["runs"] if run["rules"] == "published"}
    for run in data["runs"]:
        x = run["results"]
        base = published.get((run["backbone"], run["scene"])) if run["rules"] == "default" else None

        def beside(name, text):
            return text + (f" ({x[name] / base[name]:.2f}×)" if base else "")

        def change(name, digits):
            return f"{x[name]:.{digits}f}" + (f" ({difference(x[name] - base[name], digits)})" if base else "")

        rows.append([run["backbone"], f"{run['scene']}, {x['width']}×{x['height']}", run["rules"], change("psnr", 2), change("ssim", 4),
                     change("lpips", 4), beside("primitives", f"{x['primitives']:,}"),
                     beside("train_seconds", f"{x['train_seconds']:.1f} s"), beside("fps", f"{x['fps']:.0f} fps")])
    return f"{markdown(rows)}\n\n{data['device']}, seed 0, {data['date']}: `{data['runs'][0]['results']['command']}`"


def gpu_bench():
    """Stage times, and the share of the device's limits that each reaches."""
    data = load("gpu_bench")["bench"]
    scenes = data["scenes"]
    rows = [["milliseconds (share of the limit)"] + [f"{s['splats']:,} Gaussians, {s['width']}×{s['height']}" for s in scenes]]
    order = ["activate", "project", "tile_lists", "blend", "loss", "blend_backward", "project_backward", "optimizer", "iteration",
             "count", "scoring", "blend_backward_per_splat", "iteration_per_splat"]

    def cell(scene, stage):
        effort = scene["efforts"].get(stage)
        share = f" ({max(effort['share_of_operations'], effort['share_of_bytes']):.0%})" if effort else ""
        return f"{scene['milliseconds'][stage]:.3f}{share}"

    rows += [[stage.replace("_", " ")] + [cell(s, stage) for s in scenes] for stage in order]
    limits = data["limits"]
    return (f"{markdown(rows)}\n\n{data['device']}, CUDA {data['cuda_runtime']}, {data['date'][:10]}, medians of "
            f"{data['repeats']}; limits {limits['bytes_per_second'] / 1e9:,.0f} GB/s and "
            f"{limits['operations_per_second'] / 1e12:.1f} trillion operations per second: `{data['command']}`")


def cuda_resources():
    """What the compiler reports of each kernel."""
    data = load("cuda_resources")
    rows = [["kernel", "registers", "shared memory", "local memory"]]
    for k in data["kernels"]:
        rows.append([f"`{k['kernel']}`", str(k["registers"]), f"{k['shared_bytes']} B",
                     f"{k['stack_bytes'] + k['spill_store_bytes'] + k['spill_load_bytes']} B"])
    return markdown(rows) + f"\n\nnvcc {data['nvcc']}, {data['architecture']}: `scripts/ptxas_report`"


def cuda_instructions():
    """Instructions of the blending kernels, before and after one thread had two pixels."""
    data = load("cuda_instructions")
    rows = [["", "before: one pixel per thread, 8 × 4 per warp", "two, 8 × 8", ""]]
    for kernel, counts in data["instructions"].items():
        rows.append([f"`{kernel}`, instructions"] + [str(n) for n in counts] + [f"{counts[1] / counts[0]:.2f}×"])
    for scene, visits in data["visits"].items():
        rows.append([f"splats that warps blend, bench scene {scene}"] + [f"{n:,}" for n in visits]
                    + [f"{visits[1] / visits[0]:.2f}×"])
    scene, visits = list(data["visits"].items())[-1]
    for kernel, counts in data["instructions"].items():
        both = [n * v for n, v in zip(counts, visits)]
        rows.append([f"`{kernel}`, {scene}: instructions of warps"] + [f"{n / 1e6:.0f} million" for n in both]
                    + [f"{both[1] / both[0]:.2f}×"])
    return (markdown(rows) + f"\n\nnvcc {data['nvcc']}, {data['architecture']}, {data['disassembler']}, {data['date']}: "
            "`scripts/cuda_instructions`")


TABLES = {"gpu_compare": gpu_compare, "gpu_backbones": gpu_backbones, "gpu_bench": gpu_bench, "cuda_resources": cuda_resources,
          "cuda_instructions": cuda_instructions}
