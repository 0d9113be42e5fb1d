// SPDX-License-Identifier: Apache-2.0
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "program/command_line/option_set.h"
#include "program/commands/commands.h"
#include "program/commands/trajectory_alignment.h"
#include "program/session/chosen_device.h"
#include "program/session/run_options.h"
#include "trainer/mesh/dtu.h"
#include "trainer/mesh/surface_distance.h"
#include "trainer/mesh/tanks_and_temples.h"
#include "trainer/mesh/triangle_mesh.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/json_values.h"

namespace splatboost::program {
namespace {

namespace fs = std::filesystem;

constexpr double kThreshold = 0.005;    // default, relative to the truth's diagonal, where no scene has its own
constexpr double kMostSizeRatio = 300;  // of two surfaces in the same unit; of metres and millimetres it is 1000
constexpr double kVertexSpacing = 0.5;  // relative to the threshold, as in Tanks and Temples

struct MeshEval {
  explicit MeshEval(CLI::App& app) : given(&app) {
    add_checked_option(app, "--mesh,mesh", mesh, "reconstructed mesh, .ply")->type_name("FILE");
    add_checked_option(app, "--truth,truth", truth, "true mesh or points to compare it with, .ply")->type_name("FILE");
    add_checked_option(app, "--threshold", threshold,
                       "distance for precision and recall, world units [0.005 of the truth's diagonal; with --crop of "
                       "a known scene its own]")
        ->type_name("X");
    add_checked_option(app, "--spacing", spacing,
                       "distance between the points sampled on both surfaces [half of the threshold]")
        ->type_name("X");
    add_checked_option(app, "--cut", cut, "exclude pairs farther apart from the means [no limit]")->type_name("X");
    add_checked_option(app, "--cameras", cameras,
                       "first align the mesh by its cameras: the model folder, its cameras.json, or a COLMAP model")
        ->type_name("PATH");
    add_checked_option(
        app, "--trajectory", trajectory,
        "with --cameras: their poses in the frame to align to, SCENE_COLMAP_SfM.log of Tanks and Temples")
        ->type_name("FILE");
    add_checked_option(app, "--align", align, "text file of the 4x4 matrix that transforms the mesh to the truth")
        ->type_name("FILE");
    add_checked_option(app, "--crop", crop,
                       "SCENE.json of Tanks and Temples: the volume to evaluate, in the truth's frame")
        ->type_name("FILE");
    app.add_flag("--refine", refine, "refine the alignment within --crop by ICP, as in Tanks and Temples");
    add_checked_option(
        app, "--dtu-mask", dtu_mask,
        "ObsMaskN_10.mat: volume observed by DTU's scanner, in mm; defaults are then --spacing 0.2 --cut 20")
        ->type_name("FILE");
    add_checked_option(app, "--dtu-plane", dtu_plane,
                       "PlaneN.mat: plane of the table; only DTU's scan above it is evaluated")
        ->type_name("FILE");
    app.add_flag("--vertices", vertices, "use the vertices of the mesh as its points, as in Tanks and Temples");
    add_checked_option(app, "-o,--output", output, "also write the results as JSON")->type_name("FILE");
    add_checked_option(app, "--threads", threads, "number of threads; 0: all CPUs available to the process")
        ->type_name("N")
        ->capture_default_str();
  }

  int run() {
    if (mesh.empty() || truth.empty()) throw UsageError("name two files: splatboost mesh-eval MESH.ply TRUTH.ply");
    for (const char* name : {"--threshold", "--spacing", "--cut"}) {
      const CLI::Option* option = given->get_option(name);
      if (option->count() > 0 && !(option->as<double>() > 0)) throw UsageError(std::string(name) + " must be above 0");
    }
    if (dtu_mask.empty() != dtu_plane.empty()) throw UsageError("--dtu-mask and --dtu-plane must be given together");
    if (!dtu_mask.empty() && !crop.empty())
      throw UsageError("--crop is for Tanks and Temples, --dtu-mask for DTU: give only one");
    if (refine && crop.empty()) throw UsageError("--refine needs --crop: the volume that is aligned");
    if (cameras.empty() != trajectory.empty()) throw UsageError("--cameras and --trajectory must be given together");
    check_threads(threads);
    if (!output.empty()) {
      if (output.extension() != ".json") throw UsageError("--output must end in .json");
      std::vector<fs::path> inputs = {mesh, truth, cameras, trajectory, align, crop, dtu_mask, dtu_plane};
      if (!cameras.empty()) inputs.push_back(cameras / "cameras.json");
      require_replaceable(output, inputs);
      require_earlier_output(output, {"accuracy", "completeness", "f1"}, "splatboost mesh-eval");
      require_writable(output);
    }
    Threads workers(threads);
    const bool dtu = !dtu_mask.empty();
    const DtuMask mask = dtu ? read_dtu_mask(dtu_mask) : DtuMask{};
    const std::array<double, 4> table = dtu ? read_dtu_plane(dtu_plane) : std::array<double, 4>{};
    if (dtu && !(spacing > 0)) spacing = kDtuSpacing;
    if (dtu && !(cut > 0)) cut = kDtuCut;
    const CropVolume volume = crop.empty() ? CropVolume{} : read_crop_volume(crop);
    std::optional<TrajectoryAlignment> by_cameras;
    if (!cameras.empty()) by_cameras = align_to_trajectory(cameras, trajectory);
    TriangleMesh found = read_mesh(mesh);
    const TriangleMesh known = read_mesh(truth);
    if (by_cameras) transform_points(by_cameras->transform, found.positions);
    if (!align.empty()) transform_points(read_transform(align), found.positions);
    if (!(threshold > 0) && !crop.empty()) threshold = tanks_and_temples_threshold(crop.stem().string()).value_or(0);
    if (!(threshold > 0)) threshold = kThreshold * diagonal_of(known);
    require(threshold > 0, truth.string() + ": all points coincide; set --threshold");
    if (!(spacing > 0)) spacing = kVertexSpacing * threshold;
    if (vertices) found.triangles.clear();
    if (crop.empty()) require_like_size(found, known);
    // DTU's scan is used as it is: no points are added or removed.
    std::vector<float> points = sample_surface(found, spacing);
    std::vector<float> others = dtu ? known.positions : sample_surface(known, spacing);
    std::array<double, 16> refinement{};
    if (refine) {
      refinement = refined_alignment(points, others, volume, threshold, workers);
      transform_points(refinement, points);
    }
    if (!crop.empty()) {
      points = voxel_means(cropped(points, volume), spacing);
      others = voxel_means(cropped(others, volume), spacing);
    } else {
      points = thin_points(points, spacing, 0);
      if (!dtu) others = thin_points(others, spacing, 0);
    }
    const std::optional<double> most = cut > 0 ? std::optional<double>(cut) : std::nullopt;
    const SurfaceDistance d = dtu ? compare_as_dtu(points, others, mask, table, workers)
                                  : compare_surfaces(points, others, threshold, most, workers);
    if (by_cameras) {
      std::printf("cameras       %zu aligned with an error of %.4g, scale %.6g; %zu left out\n", by_cameras->cameras,
                  by_cameras->rmse, by_cameras->scale, by_cameras->left_out);
    }
    const double diagonal = diagonal_of(known);
    std::printf("accuracy      %.6g  (median %.6g", d.accuracy, d.median_accuracy);
    // A truth whose points coincide has no size.
    if (diagonal > 0) std::printf(", %.4f %% of the truth's diagonal", 100 * d.median_accuracy / diagonal);
    std::printf(")\n");
    std::printf("completeness  %.6g\n", d.completeness);
    std::printf("chamfer       %.6g\n", d.chamfer);
    std::printf("precision     %.4f\nrecall        %.4f\nF1            %.4f  (threshold %.4g)\n", d.precision, d.recall,
                d.f1, threshold);
    if (!output.empty()) {
      nlohmann::json json = {{"accuracy", d.accuracy},
                             {"median_accuracy", d.median_accuracy},
                             {"completeness", d.completeness},
                             {"chamfer", d.chamfer},
                             {"precision", d.precision},
                             {"recall", d.recall},
                             {"f1", d.f1},
                             {"threshold", threshold},
                             {"spacing", spacing},
                             {"diagonal", diagonal},
                             {"mesh_points", d.found_points},
                             {"truth_points", d.true_points}};
      if (by_cameras) {
        json["trajectory"] = {{"transform", by_cameras->transform},
                              {"scale", by_cameras->scale},
                              {"rmse", by_cameras->rmse},
                              {"cameras", by_cameras->cameras},
                              {"left_out", by_cameras->left_out}};
      }
      if (refine) json["refinement"] = refinement;
      write_text_atomically(output, json.dump(2) + "\n");
    }
    return 0;
  }

 private:
  /// Compares the observed points with the whole scan, and the scan above the table with all points near the box.
  SurfaceDistance compare_as_dtu(const std::vector<float>& points, const std::vector<float>& scan, const DtuMask& mask,
                                 const std::array<double, 4>& table, const Threads& workers) const {
    const std::vector<float> near = near_mask(points, mask), seen = observed(near, mask);
    const std::vector<float> standing = above_plane(scan, table);
    require(!seen.empty(),
            "no part of the mesh lies in the volume observed by DTU's scanner: is it in DTU's frame, in mm? (--align)");
    require(!standing.empty(), truth.string() + ": none of its points lies above the plane of --dtu-plane");
    return summarize_distances(nearest_distances(seen, scan, workers), nearest_distances(standing, near, workers),
                               threshold, cut);
  }

  /// Refuses surfaces of which one is so much larger that they cannot be in the same unit.
  void require_like_size(const TriangleMesh& found, const TriangleMesh& known) const {
    if (!(diagonal_of(found) > 0 && diagonal_of(known) > 0)) return;
    const double ratio = diagonal_of(found) / diagonal_of(known);
    require(!(ratio > kMostSizeRatio), mesh.string() + ": is " + shown(ratio) + " times as large as " + truth.string() +
                                           ": are they in the same unit and frame? (--align)");
    require(!(ratio < 1 / kMostSizeRatio), truth.string() + ": is " + shown(1 / ratio) + " times as large as " +
                                               mesh.string() + ": are they in the same unit and frame? (--align)");
  }

  static std::string shown(double ratio) {
    char text[32];
    std::snprintf(text, sizeof text, ratio < 1e9 ? "%.0f" : "%.3g", ratio);
    return text;
  }

  static double diagonal_of(const TriangleMesh& mesh) {
    double squared = 0;
    for (std::size_t c = 0; c < 3; ++c) {
      float low = mesh.positions[c], high = low;
      for (std::size_t k = c; k < mesh.positions.size(); k += 3) {
        low = std::min(low, mesh.positions[k]);
        high = std::max(high, mesh.positions[k]);
      }
      squared += std::pow(static_cast<double>(high) - static_cast<double>(low), 2);
    }
    return std::sqrt(squared);
  }

  CLI::App* given;
  fs::path mesh, truth, cameras, trajectory, align, crop, dtu_mask, dtu_plane, output;
  double threshold = 0, spacing = 0, cut = 0;
  bool vertices = false, refine = false;
  int threads = 0;
};

}  // namespace

Command add_mesh_eval(CLI::App& program) {
  CLI::App* app = program.add_subcommand("mesh-eval", "Measure a mesh against the true surface");
  app->footer("Example: splatboost mesh-eval OUT/mesh.ply truth.ply --threshold 0.01");
  const auto eval = std::make_shared<MeshEval>(*app);
  return {app, [eval](const std::string&) { return eval->run(); }};
}

}  // namespace splatboost::program
