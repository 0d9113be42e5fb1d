// SPDX-License-Identifier: Apache-2.0
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <memory>

#include "program/command_line/shared_options.h"
#include "program/commands/commands.h"
#include "program/session/scene_files.h"
#include "splatboost/clearance.h"
#include "splatboost/threads.h"
#include "trainer/dataset/splat_ply.h"
#include "trainer/formats/read_scene.h"
#include "trainer/points/triangulated_points.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/text.h"

namespace splatboost::program {
namespace {

namespace fs = std::filesystem;

struct PointsOptions {
  SceneOptions scene;
  fs::path output;
  bool features_only = false;
};

/// Throws InputError if the file may be the only one with the points of the scene, or is another file of it.
void require_points_elsewhere(const fs::path& file, const fs::path& scene) {
  if (!lies_in(file, scene)) return;
  require(file.filename() == "points3D.ply" || !fs::exists(file),
          file.string() + ": is a file of the scene, which would be replaced; write points3D.ply or a new file");
  const fs::path folder = fs::absolute(file).lexically_normal().parent_path();
  require(fs::exists(folder / "points3D.bin") || fs::exists(folder / "points3D.txt"),
          file.string() +
              ": holds points of the scene, which would be replaced, and there is no points3D.bin or "
              "points3D.txt beside it; move it away, or write another file");
}

int run_points(const PointsOptions& options) {
  const std::string scene_name = options.scene.source.string();
  if (scene_name.empty()) throw UsageError("no scene given: name it with -s/--source");
  if (options.output.empty()) throw UsageError("no file to write given: name it with -o/--output, FILE.ply");
  if (options.output.extension() != ".ply") {
    throw UsageError(options.output.string() + ": the file name of points must end in .ply");
  }
  require_replaceable(options.output, {options.scene.source});
  require_points_elsewhere(options.output, options.scene.source);
  require_no_model(options.output);
  require_writable(options.output);  // before the photos are read
  Scene scene = read_scene(options.scene);
  require_replaceable(options.output, {scene.points_file});
  for (const std::string& note : scene.notes) std::fprintf(stderr, "note: %s\n", printable(note).c_str());
  require(!moves(scene), scene_name + ": points can only be added to scenes that do not move");
  require(!points_are_random(scene.points.positions),
          scene_name + ": its points are random, and none are added to these");
  const std::size_t known = scene.lacks_points ? 0 : scene.points.size();
  // Where the dataset has no points, read_scene() has triangulated all.
  if (may_add_points(scene)) {
    const auto triangulate = options.features_only ? triangulate_features : triangulate_points;
    scene.more_points = triangulate(scene, Threads());
  }
  const PointCloud all = starting_points(scene);
  require(all.size() > known, scene_name +
                                  ": no points could be added: the photos have too little texture or overlap, "
                                  "or features are wanted of a program that was built without OpenCV");
  remove_stale_files(fs::absolute(options.output).parent_path());
  write_point_ply(options.output, all);
  std::printf("points: %s (%zu of the dataset, %zu added)\n", options.output.c_str(), known, all.size() - known);
  return 0;
}

}  // namespace

Command add_points(CLI::App& program) {
  CLI::App* app = program.add_subcommand("points", "Write the points of a scene, with more where its photos show none");
  app->footer(
      "For patched checkouts, which read the file: splatboost points -s SCENE -o SCENE/sparse/0/points3D.ply --eval\n"
      "Accelerated runs of vanilla and Mip-Splatting add the same points themselves.");
  const auto options = std::make_shared<PointsOptions>();
  add_checked_option(*app, "-s,--source", options->scene.source, "scene folder or packed scene")->type_name("DIR");
  add_checked_option(*app, "-o,--output", options->output, "file to write")->type_name("FILE.ply");
  add_checked_option(*app, "-r,--resolution", options->scene.resolution, kResolutionHelp)->type_name("N");
  add_checked_option(*app, "-i,--images", options->scene.images, kImagesHelp)->type_name("NAME");
  app->add_flag("--eval", options->scene.eval, "do not look at the test views, as a run with --eval");
  app->add_flag("--features-only", options->features_only,
                "add points of features that several photos share only: for Scaffold-GS, Octree-GS and convexes; "
                "no effect if the dataset has no points");
  return {app, [options](const std::string&) { return run_points(*options); }};
}

}  // namespace splatboost::program
