// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>
#include <optional>

#include <unistd.h>

#include "program/command_line/saved_model_options.h"
#include "program/commands/commands.h"
#include "program/session/model_folder.h"
#include "program/session/saved_model.h"
#include "program/session/scene_files.h"
#include "splatboost/surface_depth.h"
#include "trainer/dataset/scene_depths.h"
#include "trainer/dataset/splat_ply.h"
#include "trainer/dataset/view_image.h"
#include "trainer/evaluation/evaluate.h"
#include "trainer/images/image_codec.h"
#include "trainer/images/image_damage.h"
#include "trainer/mesh/mesh_picture.h"
#include "trainer/mesh/tsdf_volume.h"
#include "trainer/report/report.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/json_values.h"
#include "trainer/support/text.h"
#include "trainer/training/trainer.h"

namespace splatboost::program {
namespace {

namespace fs = std::filesystem;

constexpr double kVoxelsAcross = 400;          // default: voxels along the largest depth of the mesh
constexpr double kFarPoints = 0.95;            // default of the largest depth: this quantile of the point depths, ...
constexpr double kReach = 1.2;                 // ... times this factor
constexpr std::size_t kDepths = 10'000'000;    // at most so many point depths are compared, for the quantile
constexpr float kMinAlpha = 0.5f;              // least alpha of a pixel that shows a surface
constexpr double kMostVoxelsAcross = 1 << 22;  // voxels along the largest depth; single precision resolves no more
constexpr double kTruncation = 4;              // voxels
constexpr auto kShownEvery = std::chrono::seconds(2);          // progress, where the output is not a terminal
constexpr std::uint64_t kMaxMemory = ~std::uint64_t{0} >> 20;  // MiB, so that bytes do not overflow

/// The depth within which most points lie in the training views that see them, with a margin; 0 without points.
double far_depth(const Scene& scene) {
  std::vector<float> depths;
  const std::size_t step = 1 + scene.train.size() * scene.points.size() / kDepths;
  for (const View& view : scene.train) {
    const std::vector<float> of_view = depths_in_view(view.camera, scene.points, step);
    depths.insert(depths.end(), of_view.begin(), of_view.end());
  }
  if (depths.empty()) return 0;
  const auto place = depths.begin() + static_cast<std::ptrdiff_t>(kFarPoints * static_cast<double>(depths.size() - 1));
  std::nth_element(depths.begin(), place, depths.end());
  return kReach * static_cast<double>(*place);
}

struct Mesh {
  explicit Mesh(CLI::App& app) : set(app) {
    add_saved_model_options(set, options);
    set.set_group("Output");
    set.add("-o,--output", output, "mesh to write, .ply or .glb [mesh.ply in the model folder]", false)
        ->type_name("FILE");
    set.add("--voxel-size", voxel, "voxel size, world units [maximum depth / 400]", false)->type_name("X");
    set.add("--max-depth", max_depth,
            "leave out surfaces farther away, world units; 0: no limit [from the sparse points]", false)
        ->type_name("X");
    set.add("--max-angle", max_angle, "leave out surfaces at a steeper angle to a view, degrees between ray and normal",
            false)
        ->type_name("X")
        ->capture_default_str();
    set.add("--least-views", least_views, "number of views that must see a surface", false)
        ->type_name("N")
        ->capture_default_str();
    set.add("--least-triangles", least_triangles, "remove disconnected parts with fewer triangles", false)
        ->type_name("N")
        ->capture_default_str();
    set.add("--parts", parts, "number of the largest parts to keep; 0: all", false)
        ->type_name("N")
        ->capture_default_str();
    set.add("--time", time, "time in [0, 1] of the mesh, for a moving scene", false)->type_name("T");
    set.add("--masks", masks, "folder of PNG masks named like the views; black pixels are left out", false)
        ->type_name("DIR");
    set.add("--max-memory", max_memory, "memory limit of the volume, MiB", false)
        ->type_name("N")
        ->capture_default_str();
    add_drawing_options(set, options);
  }

  int run() {
    require_model(options);
    if (set.given("voxel-size") && !(voxel > 0)) throw UsageError("--voxel-size must be above 0");
    if (!(max_depth >= 0)) throw UsageError("--max-depth must be at least 0");
    if (!(max_angle > 0 && max_angle <= 90)) throw UsageError("--max-angle must lie in (0, 90]");
    if (time && !(*time >= 0 && *time <= 1)) throw UsageError("--time must be in [0, 1]");
    if (least_views < 1) throw UsageError("--least-views must be at least 1");
    if (!output.empty() && output.extension() != ".ply" && output.extension() != ".glb") {
      throw UsageError("--output must end in .ply or .glb");
    }
    if (max_memory > kMaxMemory)
      throw UsageError("--max-memory must be at most " + std::to_string(kMaxMemory) + " MiB");
    require(masks.empty() || fs::is_directory(masks), masks.string() + ": no such folder of masks");
    if (!has_tsdf_volumes()) TsdfVolume absent({});  // throws: the message says what to install
    const SavedModel saved = find_saved_model(set, options);
    if (!output.empty()) {
      require_replaceable(output, {saved.folder / "point_cloud.ply"});
      require_no_scene_file(output, scenes_of(options.model, read_config(options.model), options.scene.source),
                            options.model);
      require_no_model(output);
      require_writable(output);  // before the photos are read
    }
    const bool of_the_end = saved.folder == saved_model(options.model, 0);
    if (output.empty() && !of_the_end) {
      throw UsageError("--iteration: this mesh would replace that of the run; name a file for it with --output");
    }
    options.lpips.clear();  // nothing is measured
    OpenModel model(saved, options);
    const bool of_the_run = is_scene_of_run(read_config(options.model), options.scene.source, model.scene());
    if (output.empty() && !of_the_run) {
      throw UsageError(options.scene.source.string() +
                       ": another scene than that of the run, whose mesh would be replaced; name a file for this one "
                       "with --output");
    }
    if (!output.empty()) require_replaceable(output, {model.scene().points_file});  // may be outside of the folder
    const std::size_t views = model.scene().train.size();
    require(static_cast<std::size_t>(least_views) <= views,
            "--least-views must be at most " + std::to_string(views) + ", the number of training views");
    require(model.backbone().has_surfaces(), "backbone " + options.backbone +
                                                 " renders no depth, which a mesh is made from" +
                                                 (find_backbone(options.backbone).export_mesh != nullptr
                                                      ? ": splatboost export writes its primitives as triangles"
                                                      : ""));
    const bool moves = model.backbone().uses_time();
    require(moves || !time, "--time: a model of backbone " + options.backbone + " does not change with time");
    require(time || !moves, "the model changes with time: set the time of the mesh with --time T, from 0 to 1");
    std::optional<FolderLock> lock;
    if (output.empty()) {
      output = options.model / "mesh.ply";
      lock.emplace(options.model);
      require_writable(output);
    }

    const double far = far_depth(model.scene());
    if (!set.given("max-depth")) max_depth = far;
    const double reach = max_depth > 0 ? max_depth : far;
    if (!set.given("voxel-size")) {
      require(reach > 0, "the scene has no points to determine its size: set --voxel-size and --max-depth");
      voxel = reach / kVoxelsAcross;
    }
    require(reach / voxel < kMostVoxelsAcross, "--voxel-size " + readable(static_cast<float>(voxel)).dump() +
                                                   " is too small for a depth of " +
                                                   readable(static_cast<float>(reach)).dump() + ": give a larger one");
    TsdfVolume volume({static_cast<float>(voxel), static_cast<float>(kTruncation * voxel), max_memory << 20});
    const Threads& threads = model.bench().device->threads();
    require_surface(fuse(model.backbone(), model.scene(), volume, threads));
    TriangleMesh mesh = volume.mesh(least_views, threads);
    require(mesh.size() > 0, "no surface is seen by " + std::to_string(least_views) + " views in voxels of " +
                                 readable(static_cast<float>(voxel)).dump() + ": lower --least-views or --voxel-size");
    const std::size_t all_parts = keep_largest_parts(mesh, least_triangles, parts);
    require(mesh.size() > 0, "each of the " + std::to_string(all_parts) + " parts of the mesh has fewer than " +
                                 std::to_string(least_triangles) + " triangles: lower --least-triangles");
    write_mesh(output, mesh);
    std::printf(
        "mesh: %s (%zu vertices, %zu triangles; %zu parts before small ones were removed; voxel %.4g, depth up to "
        "%.4g)\n",
        output.c_str(), mesh.vertices(), mesh.size(), all_parts, voxel, max_depth);
    if (!of_the_run) {
      std::printf("%s is another scene than that of the run: its report does not show the mesh\n",
                  options.scene.source.c_str());
      return 0;
    }
    if (!of_the_end) {
      std::printf("the mesh is of an earlier iteration: the report of the run does not show it\n");
      return 0;
    }
    try {
      if (!lock) lock.emplace(options.model);
    } catch (const InputError& error) {
      // The mesh is elsewhere and complete.
      std::fprintf(stderr, "note: no picture of the mesh: %s\n", printable(error.what()).c_str());
      return 0;
    }
    std::printf("picture: %s\n", write_picture(mesh, model.scene()).c_str());
    return 0;
  }

 private:
  /// Draws the mesh from the first measured view, into the run's folder, which must be locked, and its report.
  fs::path write_picture(const TriangleMesh& mesh, const Scene& scene) const {
    const Camera& camera = measured_views(scene).front().camera;
    fs::path picture = options.model / "mesh.png";
    write_png(picture, camera.width, camera.height, 1, std::span<const std::uint8_t>(draw_mesh(mesh, camera)));
    show_mesh_in_report(options.model / "report.html", picture);
    return picture;
  }

  /// Numbers of pixels in all views.
  struct SurfacePixels {
    std::size_t drawn = 0;   ///< that show the model
    std::size_t near = 0;    ///< and are not too far
    std::size_t wanted = 0;  ///< and not masked
    std::size_t facing = 0;  ///< and at an angle that is not too steep
  };

  void require_surface(const SurfacePixels& pixels) const {
    require(pixels.drawn > 0, "no training view shows a surface of the model");
    require(pixels.near > 0, "all surfaces are farther away than " + readable(static_cast<float>(max_depth)).dump() +
                                 ": increase --max-depth, or use 0 for no limit");
    require(pixels.wanted > 0, "all surfaces are masked: masks are black where pixels are left out");
    require(pixels.facing > 0, "all surfaces are at a steeper angle than " +
                                   readable(static_cast<float>(max_angle)).dump() + " degrees: increase --max-angle");
  }

  SurfacePixels fuse(Backbone& backbone, const Scene& scene, TsdfVolume& volume, const Threads& threads) {
    SurfacePixels counted;
    const bool terminal = isatty(STDERR_FILENO) != 0;
    auto shown = std::chrono::steady_clock::now();
    const float least_cosine = std::cos(static_cast<float>(max_angle) * 3.14159265f / 180);
    std::vector<float> color, depth, alpha, normals;
    for (std::size_t v = 0; v < scene.train.size(); ++v) {
      const View& view = scene.train[v];
      const Camera& camera = view.camera;
      const std::size_t pixels = static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
      color.resize(3 * pixels);
      depth.resize(pixels);
      alpha.resize(pixels);
      normals.resize(3 * pixels);
      backbone.render_surface(camera, time.value_or(view.time), std::nullopt, {color, depth, alpha});
      depth_normals(camera, depth, normals, threads);
      const std::vector<std::uint8_t> mask = mask_of(view);
      for (std::size_t p = 0; p < pixels; ++p) {
        const std::size_t row = p / static_cast<std::size_t>(camera.width),
                          column = p % static_cast<std::size_t>(camera.width);
        const float x = static_cast<float>(column) + 0.5f, y = static_cast<float>(row) + 0.5f;
        const glm::vec3 ray = glm::normalize(glm::vec3((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1));
        const glm::vec3 normal(normals[p], normals[pixels + p], normals[2 * pixels + p]);
        const bool drawn = alpha[p] >= kMinAlpha && std::isfinite(depth[p]) && depth[p] > 0;
        const bool near = drawn && !(max_depth > 0 && static_cast<double>(depth[p]) > max_depth);
        const bool wanted = near && (view.valid.empty() || view.valid[p] != 0) && (mask.empty() || mask[p] != 0);
        const bool facing = wanted && !(max_angle < 90 && -glm::dot(ray, normal) < least_cosine);
        counted.drawn += drawn ? 1 : 0;
        counted.near += near ? 1 : 0;
        counted.wanted += wanted ? 1 : 0;
        counted.facing += facing ? 1 : 0;
        if (!facing) depth[p] = 0;
      }
      volume.integrate(camera, depth, color, threads);
      const auto now = std::chrono::steady_clock::now();
      const bool last = v + 1 == scene.train.size();
      if (options.quiet || (!terminal && !last && now - shown < kShownEvery)) continue;
      shown = now;
      std::fprintf(stderr, "%sfused %zu of %zu views, %llu MiB%s", terminal ? "\r" : "", v + 1, scene.train.size(),
                   static_cast<unsigned long long>(volume.bytes() >> 20), terminal && !last ? "" : "\n");
    }
    return counted;
  }

  /// Mask [H,W] of the view's size; empty: no masks.
  std::vector<std::uint8_t> mask_of(const View& view) {
    if (masks.empty()) return {};
    fs::path name = view.name;
    // With such a name, `masks / name` could be the photo.
    const bool elsewhere = name.is_absolute() || *name.begin() == "..";
    if (elsewhere) name = name.filename();
    const fs::path file = masks / name.replace_extension(".png");
    require(fs::exists(file), file.string() + ": missing; each view needs a mask with its name");
    require(fs::is_regular_file(file), file.string() + ": is not a file");
    if (elsewhere) {
      const auto [other, first] = masks_by_file_name.try_emplace(file, view.name);
      require(first, file.string() + ": would be the mask of both " + other->second + " and " + view.name +
                         "; copy the photos to names below the folder of the scene");
    }
    std::ifstream in(file, std::ios::binary);
    const std::vector<std::uint8_t> bytes{std::istreambuf_iterator<char>(in), {}};
    require_whole_image(bytes, file);
    const Pixels pixels = mask_of_picture(decode_image(bytes, file));
    const int width = view.camera.width, height = view.camera.height;
    // Up to one pixel of the view, because sizes are rounded.
    require(std::abs(pixels.width * height - pixels.height * width) <= std::max(pixels.width, pixels.height),
            file.string() + ": has " + std::to_string(pixels.width) + "x" + std::to_string(pixels.height) +
                " pixels, which is not the shape of the view, " + std::to_string(width) + "x" + std::to_string(height));
    std::vector<std::uint8_t> mask;
    for (int y = 0; y < view.camera.height; ++y) {
      for (int x = 0; x < view.camera.width; ++x) {
        const int row = y * pixels.height / view.camera.height, column = x * pixels.width / view.camera.width;
        const std::size_t pixel =
            static_cast<std::size_t>(row) * static_cast<std::size_t>(pixels.width) + static_cast<std::size_t>(column);
        mask.push_back(pixels.bytes[pixel]);
      }
    }
    return mask;
  }

  RunOptions options;
  OptionSet set;
  fs::path output, masks;
  std::map<fs::path, std::string> masks_by_file_name;  ///< and their views, whose names are not below the scene
  double voxel = 0, max_depth = 0, max_angle = 80;
  std::optional<float> time;
  int least_views = 1;
  std::size_t least_triangles = 50, parts = 0;
  std::uint64_t max_memory = 4096;
};

}  // namespace

Command add_mesh(CLI::App& program) {
  CLI::App* app = program.add_subcommand("mesh", "Make a mesh of the surfaces of a model");
  app->footer("Example: splatboost mesh -m OUT -o mesh.glb");
  const auto mesh = std::make_shared<Mesh>(*app);
  return {app, [mesh](const std::string&) { return mesh->run(); }};
}

}  // namespace splatboost::program
