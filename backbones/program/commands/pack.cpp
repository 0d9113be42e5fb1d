// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <memory>

#include "program/command_line/shared_options.h"
#include "program/commands/commands.h"
#include "trainer/formats/packed_scene.h"
#include "trainer/formats/read_scene.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/text.h"

namespace splatboost::program {
namespace {

namespace fs = std::filesystem;

constexpr char kExtension[] = ".sbscene";

struct PackOptions {
  SceneOptions scene;
  fs::path output;
};

int run_pack(const PackOptions& options) {
  const SceneOptions& scene = options.scene;
  if (scene.source.empty()) throw UsageError("no scene given: splatboost pack SCENE OUT.sbscene");
  if (options.output.empty()) throw UsageError("no file to write given: splatboost pack SCENE OUT.sbscene");
  if (options.output.extension() != kExtension) {
    throw UsageError(options.output.string() + ": the file name of a packed scene must end in " + kExtension);
  }
  require_replaceable(options.output, {scene.source});
  std::error_code error;
  require(!fs::exists(options.output, error) || fs::is_empty(options.output, error) || is_packed_scene(options.output),
          options.output.string() + ": exists and is not a packed scene; name another file");
  require_writable(options.output);  // before the photos are read
  remove_stale_files(fs::absolute(options.output).parent_path());
  for (const std::string& note : pack_scene(scene, options.output))
    std::fprintf(stderr, "note: %s\n", printable(note).c_str());
  std::printf("packed scene: %s (%.1f MB)\n", options.output.c_str(),
              static_cast<double>(fs::file_size(options.output)) / 1e6);
  return 0;
}

}  // namespace

Command add_pack(CLI::App& program) {
  CLI::App* app = program.add_subcommand("pack", "Pack a scene into one file that loads fast and without OpenCV");
  app->footer("Example: splatboost pack SCENE scene.sbscene && splatboost train -s scene.sbscene -m OUT --eval");
  const auto options = std::make_shared<PackOptions>();
  add_checked_option(*app, "-s,--source,source", options->scene.source,
                     "scene folder: COLMAP, Blender, nerfstudio, Nerfies or rig of videos")
      ->type_name("DIR");
  add_checked_option(*app, "-o,--output,output", options->output, "file to write")->type_name("FILE.sbscene");
  add_checked_option(*app, "-r,--resolution", options->scene.resolution, kResolutionHelp)->type_name("N");
  add_checked_option(*app, "-i,--images", options->scene.images, kImagesHelp)->type_name("NAME");
  app->add_flag("--frame-times", options->scene.frame_times, kFrameTimesHelp);
  add_checked_option(*app, "--frames", options->scene.frames, kFramesHelp)->type_name("N");
  return {app, [options](const std::string&) { return run_pack(*options); }};
}

}  // namespace splatboost::program
