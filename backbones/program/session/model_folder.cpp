// SPDX-License-Identifier: Apache-2.0
#include "program/session/model_folder.h"

#include <algorithm>
#include <charconv>
#include <iterator>
#include <string_view>

#include "program/session/run.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/json_values.h"
#include "trainer/support/own_files.h"
#include "trainer/training/data_identity.h"

namespace splatboost::program {
namespace {

using Json = nlohmann::json;
namespace fs = std::filesystem;

constexpr std::string_view kSavedPrefix = "iteration_";

constexpr std::string_view kPictures = R"((renders|truth|surfaces|times)/[^/]+\.png)";
/// What runs, and commands after them, write in the folder of a run, and a new run there deletes.
constexpr OwnEntry kResults[] = {
    {"point_cloud", R"(iteration_[0-9]+/(point_cloud\.ply|parameters\.bin|nets\.bin|convexes\.bin))"},
    {"test", kPictures},
    {"train", kPictures},
    {"orbit", R"([0-9]+\.png)"},
    {"sequence", R"([0-9]+\.ply)"},
    // points3D.ply: trainers in Python write it beside points3D.bin.
    {"keyframes", R"(images/[^/]+\.png|sparse/0/(cameras|images|points3D)\.bin|sparse/0/points3D\.ply)"},
    {kTrainingFile, {}},
    {"results.json", {}},
    {"compare.json", {}},
    {"report.html", {}},
    {"cameras.json", {}},
    {"mesh.ply", {}},
    {"mesh.png", {}},
    {"keyframes.txt", {}},
    {"trajectory.txt", {}}};

/// Keys of config.json in which two configs of the same run may differ.
constexpr const char* kNotOfTheRun[] = {"device", "threads",   "lpips", "save-iterations", "checkpoint-iterations",
                                        "source", "splatboost"};

/// The number of "iteration_N", -1 for any other name.
int iteration_of(const std::string& name) {
  const std::string_view text(name);
  if (text.substr(0, kSavedPrefix.size()) != kSavedPrefix) return -1;
  int iteration = 0;
  const char* const end = text.data() + text.size();
  const auto parsed = std::from_chars(text.data() + kSavedPrefix.size(), end, iteration);
  return parsed.ec == std::errc{} && parsed.ptr == end ? iteration : -1;
}

/// config.json of the folder; an empty object if there is none or it cannot be read.
Json config_in(const fs::path& folder) {
  try {
    return read_settings_file(folder / "config.json");
  } catch (const InputError&) {
    return Json::object();
  }
}

bool is_ours(const fs::path& folder) { return config_in(folder).contains("splatboost"); }

bool is_comparison(const fs::path& folder) { return is_ours(folder) && !config_in(folder).contains("trained"); }

/// The checksums of a run's data in its config.json; null: it has none (slam, earlier versions).
Json data_in(const Json& config) {
  const Json::json_pointer data("/trained/data");
  return config.contains(data) ? config.at(data) : Json();
}

/// What differs between the configs of two runs, in words; empty: they are of the same run.
std::string run_difference(Json one, Json other) {
  const Json data = data_in(one), other_data = data_in(other);
  for (Json* config : {&one, &other}) {
    for (const char* key : kNotOfTheRun) config->erase(key);
    if (config->contains("trained") && config->at("trained").is_object()) config->at("trained").erase("data");
  }
  const Json changes = Json::diff(one, other);
  if (changes.empty()) return data.is_null() || other_data.is_null() ? "" : data_difference(data, other_data);
  const std::string path = changes[0].at("path");
  const Json::json_pointer at(path);
  const auto shown = [&](const Json& config) { return config.contains(at) ? config.at(at).dump() : "none"; };
  std::string name = path.substr(1);
  for (std::size_t slash = name.find('/'); slash != std::string::npos; slash = name.find('/')) {
    name.replace(slash, 1, ": ");
  }
  return name + " = " + shown(one) + " instead of " + shown(other);
}

/// Throws InputError if the file or folder is in a part of the folder that a new run deletes.
void require_elsewhere(const fs::path& folder, const fs::path& input) {
  if (input.empty()) return;
  std::error_code error;
  const fs::path inside = fs::weakly_canonical(input, error).lexically_relative(fs::weakly_canonical(folder, error));
  require(
      inside.empty() || std::ranges::find(kResults, inside.begin()->native(), &OwnEntry::name) == std::end(kResults),
      input.string() + " is in the run in " + folder.string() +
          ", which this run would replace; move it elsewhere, or choose another --model");
}

Json camera_json(const View& view, std::size_t id, const char* split) {
  const Camera& camera = view.camera;
  const glm::mat3 world_from_camera = glm::transpose(camera.rotation());
  const glm::vec3 position = camera.centre();
  Json rows = Json::array();
  for (int row = 0; row < 3; ++row) {
    rows.push_back({world_from_camera[0][row], world_from_camera[1][row], world_from_camera[2][row]});
  }
  return {{"id", id},
          {"img_name", view.name},
          {"split", split},
          {"width", camera.width},
          {"height", camera.height},
          {"position", {position.x, position.y, position.z}},
          {"rotation", rows},
          {"fx", camera.fx},
          {"fy", camera.fy}};
}

}  // namespace

void require_ours_or_empty(const fs::path& folder) {
  std::error_code error;
  if (!fs::exists(folder, error)) return;
  require(fs::is_directory(folder, error), folder.string() + ": is not a folder; give another --model");
  bool empty = true;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    empty = empty && is_working_file(entry->path());
  }
  require(!error, folder.string() + ": cannot be read: " + error.message());
  require(empty || is_ours(folder),
          folder.string() +
              ": contains files that do not belong to a SplatBoost run and would be mixed with it; "
              "give another --model");
}

void require_only_results(const fs::path& folder) {
  if (!is_ours(folder)) return;
  if (const std::optional<fs::path> foreign = find_foreign_file(folder, kResults)) {
    throw InputError(foreign->string() + ": was not written by a run, and a new run in " + folder.string() +
                     " would delete it; move it away, or choose another --model");
  }
}

bool holds_run(const fs::path& folder) { return is_ours(folder); }

void require_inputs_elsewhere(const fs::path& folder, const RunOptions& options, const fs::path& more) {
  for (const fs::path& input : {options.scene.source, options.scene.test_list, options.config, options.lpips, more}) {
    require_elsewhere(folder, input);
  }
}

void require_no_comparison(const fs::path& folder) {
  require(!is_comparison(folder), folder.string() + ": is the folder of a comparison; choose another --model");
  require_no_run_of_comparison(folder);
}

void require_no_run_of_comparison(const fs::path& folder) {
  std::error_code error;
  const fs::path whole = fs::weakly_canonical(folder, error);
  const fs::path parent = whole.parent_path();
  const bool named_as_run = whole.filename() == run_label(false) || whole.filename() == run_label(true);
  // Without compare.json the comparison was interrupted: its runs may be resumed.
  require(!named_as_run || !fs::exists(parent / "compare.json", error) || !is_comparison(parent),
          folder.string() + ": is a run of a comparison, whose compare.json describes it; choose another --model");
}

void require_comparison(const fs::path& folder) {
  require(is_comparison(folder), folder.string() +
                                     ": is not the folder of a comparison; a run is resumed by splatboost train, from "
                                     "one of its checkpoints");
}

void require_same_run(const fs::path& folder, const std::string& config) {
  if (!is_ours(folder)) return;
  const std::string difference = run_difference(config_in(folder), Json::parse(config));
  require(difference.empty(),
          folder.string() + ": is of a run with " + difference + "; resume with the settings and the data of that run");
}

FolderLock take_model_folder(const fs::path& folder, const std::string& resumed) {
  std::error_code error;
  fs::create_directories(folder, error);
  require(!error, folder.string() + ": cannot create this folder: " + error.message());
  FolderLock lock(folder);
  require_ours_or_empty(folder);
  remove_stale_files(folder);
  remove_stale_files(folder / "checkpoints");
  if (!resumed.empty() && run_difference(Json::parse(resumed), config_in(folder)).empty()) return lock;
  // When a run ends, all results in the folder must be its own. Checkpoints are kept: they took hours and identify
  // their run.
  require_only_results(folder);
  remove_own_files(folder, kResults);
  return lock;
}

std::string config_text(const Json& recorded, const RunOptions& options, bool boost, const PluggedBackbone* plugged,
                        const Scene* data) {
  Json config = recorded;
  config["splatboost"] = SPLATBOOST_VERSION;
  config["backbone"] = plugged ? plugged->backbone->config() : options.backbone_settings;
  config["backbone"]["name"] = options.backbone;
  config["boost"] = boost_settings(options);
  config["boost"]["enabled"] = boost;
  if (plugged) {
    Json& trained = config["trained"];
    trained["beta"] = plugged->beta ? readable(*plugged->beta) : Json(nullptr);
    trained["background"] = options.scene.white_background ? "white" : "black";
    if (config["backbone"].contains("sh_degree")) trained["sh_degree"] = config["backbone"]["sh_degree"];
    // Two runs may differ in their data only, even below the same path.
    if (data) trained["data"] = data_identity(*data);
  }
  return config.dump(2) + "\n";
}

void write_config(const fs::path& folder, const std::string& text) {
  write_text_atomically(folder / "config.json", text);
}

void write_cameras(const fs::path& folder, const Scene& scene) {
  Json cameras = Json::array();
  for (const View& view : scene.test) cameras.push_back(camera_json(view, cameras.size(), "test"));
  for (const View& view : scene.train) cameras.push_back(camera_json(view, cameras.size(), "train"));
  write_text_atomically(folder / "cameras.json", cameras.dump() + "\n");
}

Json read_config(const fs::path& folder) {
  std::error_code error;
  require(fs::is_directory(folder, error), folder.string() + ": no such model folder");
  require(is_file(folder / "config.json"),
          folder.string() + ": not a model folder of SplatBoost: it has no config.json");
  Json config = read_settings_file(folder / "config.json");
  // Keyframes are in the folder of their run, which may have been moved or copied.
  if (config.contains("slam") && fs::is_directory(folder / "keyframes", error)) {
    config["source"] = (folder / "keyframes").string();
  }
  return config;
}

bool is_scene_of_run(const Json& config, const fs::path& source, const Scene& scene) {
  const Json data = data_in(config);
  if (!data.is_null()) return data_difference(data, data_identity(scene)).empty();
  std::error_code error;
  return fs::weakly_canonical(source, error) == fs::weakly_canonical(config.value("source", ""), error);
}

std::optional<float> trained_beta(const fs::path& folder, const Json& config) {
  const std::string file = (folder / "config.json").string(), place = file + ": trained: beta";
  require(config.contains("trained") && config["trained"].is_object() && config["trained"].contains("beta"),
          file + ": has no trained.beta: it is damaged, or not that of a run; give the --model folder of one");
  std::optional<float> beta;
  read_value(config["trained"]["beta"], place, beta);
  require(!beta || (*beta > 0 && *beta <= 1), place + " must be in (0, 1]");
  return beta;
}

fs::path saved_model(const fs::path& folder, int iteration) {
  std::error_code error;
  const fs::path run = folder / run_label(true);
  require(!is_comparison(folder) || !fs::exists(run, error),
          folder.string() + ": is the folder of a comparison; give one of its runs, such as " + run.string());
  const fs::path saved = folder / "point_cloud";
  if (iteration > 0) {
    fs::path wanted = saved / (std::string(kSavedPrefix) + std::to_string(iteration));
    require(fs::is_directory(wanted), wanted.string() + ": no model was saved at this iteration");
    return wanted;
  }
  fs::path latest;
  iteration = -1;
  for (const auto& entry : fs::directory_iterator(saved, error)) {
    // An empty folder is left by a save that was killed.
    std::error_code unreadable;
    const bool saved_there = entry.is_directory() && !fs::is_empty(entry.path(), unreadable);
    if (saved_there && iteration_of(entry.path().filename().string()) > iteration) {
      iteration = iteration_of(entry.path().filename().string());
      latest = entry.path();
    }
  }
  require(!error || error == std::errc::no_such_file_or_directory,
          saved.string() + ": cannot be read: " + error.message());
  require(!latest.empty(), saved.string() + ": no model was saved here; the run was interrupted, or has not ended");
  return latest;
}

int saved_iteration(const fs::path& saved) { return iteration_of(saved.filename().string()); }

}  // namespace splatboost::program
