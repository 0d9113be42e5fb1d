// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "program/command_line/saved_model_options.h"
#include "program/commands/commands.h"
#include "program/commands/orbit.h"
#include "program/session/model_folder.h"
#include "program/session/saved_model.h"
#include "program/session/scene_files.h"
#include "trainer/evaluation/evaluate.h"
#include "trainer/images/video.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/text.h"

namespace splatboost::program {
namespace {

namespace fs = std::filesystem;

constexpr int kVideoFrames = 120;
constexpr int kMaxSeries = 100000;              // file names have five digits
constexpr double kSlowest = 1, kFastest = 240;  // frames per second

/// Whether all cameras of an orbit are the same, because the training cameras look from one place only.
bool stands_still(const Scene& scene) {
  const std::vector<Camera> cameras = orbit_cameras(scene, 4);  // two of them are at the ends of an arc
  const glm::mat4& first = cameras.front().camera_from_world;
  for (const Camera& camera : cameras) {
    for (int column = 0; column < 4; ++column) {
      for (int row = 0; row < 4; ++row) {
        const float value = first[column][row];
        if (std::abs(camera.camera_from_world[column][row] - value) > 1e-5f * (1 + std::abs(value))) return false;
      }
    }
  }
  return true;
}

struct Render {
  explicit Render(CLI::App& app) : set(app) {
    add_saved_model_options(set, options);
    set.set_group("Output");
    set.add("-o,--output", output, "folder of the PNG files [the model folder]", false)->type_name("DIR");
    set.add("--orbit", orbit, "render N views on a circle around the scene instead of the scene's views", false)
        ->type_name("N");
    set.add("--video", video,
            "write the circle as a video instead of PNG files, of as many frames as --orbit has views [120]; time "
            "advances too",
            false)
        ->type_name("FILE.mp4");
    set.add("--time", time, "time in [0, 1] for a moving scene, instead of each view's own", false)->type_name("T");
    set.add("--view", view, "with --orbit or --video: keep this view's camera while time advances", false)
        ->type_name("NAME");
    set.add("--sequence", sequence, "write N standard .ply files from time 0 to 1 instead of images", false)
        ->type_name("N");
    set.add("--fps", frames_per_second, "frame rate of the video, 1 to 240", false)
        ->type_name("N")
        ->capture_default_str();
    add_drawing_options(set, options);
  }

  int run() {
    require_model(options);
    const auto check_count = [&](const std::string& name, int count) {
      if (set.given(name) && (count < 1 || count > kMaxSeries))
        throw UsageError("--" + name + " must be 1 to " + std::to_string(kMaxSeries));
    };
    check_count("orbit", orbit);
    check_count("sequence", sequence);
    if (!(frames_per_second >= kSlowest && frames_per_second <= kFastest)) {
      throw UsageError("--fps must be 1 to 240 frames per second");
    }
    if (set.given("fps") && video.empty()) throw UsageError("--fps requires --video");
    if (!video.empty() && !output.empty())
      throw UsageError("--output has no effect with --video, which names the file to write; leave it out");
    if (!video.empty()) {
      require_video_name(video);
      require_replaceable(video, {});
      require_writable(video);
    }
    if (time && !(*time >= 0 && *time <= 1)) throw UsageError("--time must be in [0, 1]");
    if (sequence > 0 && (!video.empty() || orbit > 0 || time || !view.empty()))
      throw UsageError("--sequence writes models: leave out --video, --orbit, --view and --time");
    if (!view.empty() && video.empty() && orbit == 0) throw UsageError("--view requires --video or --orbit");
    if (!view.empty() && time)
      throw UsageError("--view and --time cannot be combined: with --view, time advances; leave out --time");
    const SavedModel saved = find_saved_model(set, options);
    scenes = scenes_of(options.model, read_config(options.model), options.scene.source);
    if (!video.empty()) require_no_scene_file(video, scenes, options.model);  // a scene may consist of videos
    // Before the scene is read, except if the model may have to be refused first, whatever the output is.
    const bool of_time = time || !view.empty() || sequence > 0;
    if (!of_time) check_output();
    options.lpips.clear();  // nothing is measured
    OpenModel model(saved, options);
    Backbone& backbone = model.backbone();
    const Scene& scene = model.scene();
    const std::pair<const char*, bool> times[] = {
        {"--time", time.has_value()}, {"--view", !view.empty()}, {"--sequence", sequence > 0}};
    for (const auto& [name, asked] : times) {
      require(!asked || backbone.uses_time(),
              std::string(name) + ": a model of backbone " + options.backbone + " does not change with time");
    }
    if (of_time) check_output();
    if (replaces_measured() && !is_scene_of_run(read_config(options.model), options.scene.source, scene)) {
      throw UsageError(options.scene.source.string() +
                       ": another scene than that of the run, whose pictures would be replaced; name a folder for them "
                       "with --output");
    }
    std::optional<FolderLock> lock;
    if (output.empty()) {
      output = options.model;
      // A run that measures writes pictures with the same names. A video has a name of its own.
      if (video.empty()) lock.emplace(options.model);
    }
    if (sequence > 0) {
      export_sequence(backbone);
    } else if (!video.empty() || orbit > 0) {
      render_orbit(backbone, scene);
    } else {
      const std::vector<fs::path> train = pictures_of(scene.train, output / "train" / "renders"),
                                  test = pictures_of(scene.test, output / "test" / "renders");
      for (const std::vector<fs::path>* files : {&train, &test}) require_no_scene_files(*files);
      render_views(backbone, scene.train, train);
      render_views(backbone, scene.test, test);
    }
    return 0;
  }

 private:
  /// Pictures in a model folder are those that its results were measured on; others go to a folder of their own.
  bool replaces_measured() const { return own_folder && video.empty() && orbit == 0 && sequence == 0; }

  void check_output() {
    own_folder = output.empty();
    if (own_folder) {
      for (const char* name : {"iteration", "beta", "time"}) {
        if (replaces_measured() && set.given(name)) {
          throw UsageError("--" + std::string(name) +
                           ": these pictures would replace those that the run measured; name " +
                           "a folder for them with --output");
        }
      }
      return;
    }
    std::error_code error;
    const bool own = fs::equivalent(output, options.model, error);
    if (!own && (fs::exists(output / "point_cloud") || is_file(output / "compare.json"))) {
      throw UsageError("--output: " + output.string() + " is the folder of another run; name another one");
    }
    require_writable_folder(output);
  }

  /// Throws InputError if one of the files is a file of a scene. Call before the first is written.
  void require_no_scene_files(const std::vector<fs::path>& files) const {
    for (const fs::path& file : files) require_no_scene_file(file, scenes, options.model);
  }

  static std::vector<fs::path> pictures_of(const std::vector<View>& views, const fs::path& folder) {
    std::vector<fs::path> files;
    for (const std::string& name : picture_names(views)) files.push_back(folder / (name + ".png"));
    return files;
  }

  void render_views(Backbone& backbone, const std::vector<View>& views, const std::vector<fs::path>& files) const {
    if (views.empty()) return;
    const fs::path folder = files.front().parent_path();
    make_folder(folder);
    std::vector<float> color;
    for (std::size_t i = 0; i < views.size(); ++i) {
      const Camera& camera = views[i].camera;
      render(backbone, camera, time.value_or(views[i].time), color);
      write_png(files[i], color, camera.width, camera.height);
    }
    std::printf("%s: %s\n", counted(views.size(), "render").c_str(), folder.c_str());
  }

  void render_orbit(Backbone& backbone, const Scene& scene) const {
    const int count = orbit > 0 ? orbit : kVideoFrames;
    const bool time_advances = backbone.uses_time() && !time;
    require(!view.empty() || time_advances || !stands_still(scene),
            std::string(video.empty() ? "--orbit" : "--video") +
                ": the training cameras look at the scene from one place only, and a circle around it needs cameras at "
                "two or more places; render the scene's views, without --orbit and --video");
    const std::vector<Camera> cameras = view.empty()
                                            ? orbit_cameras(scene, count)
                                            : std::vector<Camera>(static_cast<std::size_t>(count), camera_of(scene));
    std::unique_ptr<VideoFile> file;
    const fs::path folder = output / "orbit";
    if (video.empty()) {
      require_no_rest(folder, count, ".png");
      require_no_scene_files(series(folder, count, ".png"));
      make_folder(folder);
    } else {
      file = std::make_unique<VideoFile>(video, cameras[0].width, cameras[0].height, frames_per_second);
    }
    std::vector<float> color;
    for (std::size_t i = 0; i < cameras.size(); ++i) {
      const Camera& camera = cameras[i];
      render(backbone, camera, time.value_or(static_cast<float>(i) / static_cast<float>(std::max(count - 1, 1))),
             color);
      if (file) {
        file->add(color);
      } else {
        write_png(folder / numbered(static_cast<int>(i), ".png"), color, camera.width, camera.height);
      }
    }
    if (file) {
      file->finish();
      std::printf("video of %s: %s\n", counted(cameras.size(), "frame").c_str(), video.c_str());
    } else {
      remove_rest(folder, count, ".png");
      std::printf("%s: %s\n", counted(cameras.size(), "render").c_str(), folder.c_str());
    }
  }

  Camera camera_of(const Scene& scene) const {
    for (const auto* views : {&scene.train, &scene.test}) {
      for (const View& candidate : *views) {
        if (candidate.name == view || fs::path(candidate.name).stem() == view) return candidate.camera;
      }
    }
    throw InputError("--view: the scene has no view '" + view + "'; an example of a view is '" +
                     scene.train.front().name + "'");
  }

  void export_sequence(Backbone& backbone) const {
    const fs::path folder = output / "sequence";
    require_no_rest(folder, sequence, ".ply");
    require_no_scene_files(series(folder, sequence, ".ply"));
    make_folder(folder);
    for (int i = 0; i < sequence; ++i) {
      backbone.export_moment(static_cast<float>(i) / static_cast<float>(std::max(sequence - 1, 1)),
                             folder / numbered(i, ".ply"));
    }
    remove_rest(folder, sequence, ".ply");
    std::printf("%s: %s\n", counted(static_cast<std::size_t>(sequence), "model").c_str(), folder.c_str());
  }

  /// The name of a file in a series: 00007.png.
  static std::string numbered(int number, const char* ending) {
    char name[32];
    std::snprintf(name, sizeof name, "%05d%s", number, ending);
    return name;
  }

  static std::vector<fs::path> series(const fs::path& folder, int count, const char* ending) {
    std::vector<fs::path> files;
    for (int i = 0; i < count; ++i) files.push_back(folder / numbered(i, ending));
    return files;
  }

  /// An earlier, longer series is of other cameras and times. Its rest is removed from the folder of the model; in
  /// another folder it may be of something else.
  void require_no_rest(const fs::path& folder, int count, const char* ending) const {
    const fs::path next = folder / numbered(count, ending);
    require(own_folder || !fs::exists(next), next.string() +
                                                 ": is of a longer series than this one would be; remove it, or name "
                                                 "another folder with --output");
  }
  static void remove_rest(const fs::path& folder, int count, const char* ending) {
    std::error_code ignored;
    while (fs::remove(folder / numbered(count, ending), ignored)) ++count;
  }

  static void render(Backbone& backbone, const Camera& camera, float time, std::vector<float>& color) {
    color.resize(3 * static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height));
    backbone.render(camera, time, std::nullopt, color);
  }

  RunOptions options;
  OptionSet set;
  fs::path output;
  std::vector<fs::path> scenes;  ///< of scenes_of(): their files must not be replaced
  bool own_folder = false;       ///< writes into the model folder
  fs::path video;
  int orbit = 0;
  std::optional<float> time;
  std::string view;
  int sequence = 0;
  double frames_per_second = 30;
};

}  // namespace

Command add_render(CLI::App& program) {
  CLI::App* app = program.add_subcommand("render", "Render a model: the scene's views, or a circle around it");
  app->footer("Example: splatboost render -m OUT --video turn.mp4");
  const auto render = std::make_shared<Render>(*app);
  return {app, [render](const std::string&) { return render->run(); }};
}

}  // namespace splatboost::program
