// SPDX-License-Identifier: Apache-2.0
#include "trainer/sequence/sequence_files.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <sstream>
#include <string_view>
#include <utility>

#include <glm/geometric.hpp>

#include "trainer/images/video.h"
#include "trainer/sequence/euroc.h"
#include "trainer/sequence/trajectory.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_values.h"
#include "trainer/support/text.h"

namespace splatboost {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr double kMaxSecondsApart = 0.02;                ///< between an image and its depth or true pose
constexpr double kFolderRate = 30;                       ///< frames per second if a dataset has no times
constexpr int kSmallestSide = 32, kLargestSide = 16384;  ///< px, of the images
constexpr double kLeastVisible = 0.25;  ///< least share of an undistorted image that the distorted one shows
constexpr int kSampledSide = 64;        ///< samples per side of the image to measure that share
constexpr char kTrackWithoutDepth[] = "to track without depth, give a --calibration without depth_scale";

constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";  ///< with which some editors begin a file

/// Keys of a calibration, and their synonyms in Replica's.
constexpr const char* kCalibrationKeys[] = {"width", "height", "fx", "fy", "cx", "cy",
                                            "k1",    "k2",     "p1", "p2", "k3", "depth_scale"};
constexpr std::pair<const char*, const char*> kSynonyms[] = {{"width", "w"}, {"height", "h"}, {"depth_scale", "scale"}};
constexpr const char* kUnsupportedKeys[] = {"k4", "k5", "k6"};

bool is_picture(const fs::path& file) {
  std::string ending = file.extension().string();
  std::ranges::transform(ending, ending.begin(), [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return ending == ".png" || ending == ".jpg" || ending == ".jpeg";
}

/// Sorted by name and number; empty where there is no such folder. Hidden files are left out: archives made on macOS
/// contain a ._NAME beside each picture.
std::vector<fs::path> pictures_in(const fs::path& folder, const std::string& prefix) {
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (name.starts_with('.') || !name.starts_with(prefix)) continue;
    if (is_picture(entry->path())) files.push_back(entry->path());
  }
  std::ranges::sort(files, in_number_order, &fs::path::native);
  return files;
}

/// The file name without prefix and extension: the frame number.
std::string key_of(const fs::path& file, std::size_t prefix) { return file.stem().string().substr(prefix); }

/// Pairs colour and depth by frame number; colour without depth is kept.
std::vector<FrameFiles> paired(const std::vector<fs::path>& color, std::size_t color_prefix,
                               const std::vector<fs::path>& depth, std::size_t depth_prefix) {
  std::map<std::string, fs::path> depths;
  for (const fs::path& file : depth) depths[key_of(file, depth_prefix)] = file;
  std::vector<FrameFiles> frames;
  for (const fs::path& file : color) {
    FrameFiles frame;
    frame.time = static_cast<double>(frames.size()) / kFolderRate;
    frame.name = file.filename().string();
    frame.color = file;
    if (const auto found = depths.find(key_of(file, color_prefix)); found != depths.end()) frame.depth = found->second;
    frames.push_back(std::move(frame));
  }
  return frames;
}

/// @param depths depth images @param frames those of find_replica() or find_folder()
/// @return SequenceFiles::depth_mismatch
std::string mismatch_of_names(const std::vector<fs::path>& depths, const std::vector<FrameFiles>& frames) {
  const bool paired = std::ranges::any_of(frames, [](const FrameFiles& frame) { return !frame.depth.empty(); });
  if (paired || depths.empty() || frames.empty()) return "";
  return depths.front().parent_path().string() + ": has " + counted(depths.size(), "depth image") +
         (depths.size() == 1 ? ", not" : ", none of them") + " named like a picture: the first depth image is " +
         depths.front().filename().string() + ", the first picture " + frames.front().color.filename().string() +
         "; rename the depth images, or, " + kTrackWithoutDepth;
}

/// The last number in a text.
std::optional<std::size_t> last_number_in(const std::string& text) {
  constexpr char kDigits[] = "0123456789";
  const std::size_t last = text.find_last_of(kDigits);
  if (last == std::string::npos) return std::nullopt;
  const std::size_t before = text.find_last_not_of(kDigits, last);
  std::size_t number = 0;
  const char* const begin = text.data() + (before == std::string::npos ? 0 : before + 1);
  const auto parsed = std::from_chars(begin, text.data() + last + 1, number);
  return parsed.ec == std::errc() ? std::optional(number) : std::nullopt;
}

/// Lines of a row-major matrix world from camera.
std::vector<glm::dmat4> read_matrices(const fs::path& file) {
  std::ifstream in(file);
  require(in.good(), file.string() + ": cannot be read");
  std::string line, surplus;
  std::vector<glm::dmat4> poses;
  for (int number = 1; std::getline(in, line); ++number) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    const std::string where = file.string() + ":" + std::to_string(number);
    std::istringstream words(line);
    glm::dmat4 pose(1.0);
    for (int row = 0; row < 4; ++row) {
      for (int column = 0; column < 4; ++column) words >> pose[column][row];
    }
    require(!words.fail() && !(words >> surplus),
            where + ": expected 16 numbers, the matrix camera to world of a picture row by row");
    require(is_rigid(pose), where + ": the matrix is not a rigid transform, a rotation and a translation");
    poses.push_back(pose);
  }
  return poses;
}

/// Frames and poses correspond in order. If their numbers differ (frames were removed, say), a frame gets the pose of
/// the number in its name, counted from 0, or none.
void read_replica_truth(const fs::path& file, SequenceFiles& files) {
  const std::vector<glm::dmat4> poses = read_matrices(file);
  const bool in_order = poses.size() == files.frames.size();
  bool any = false;
  for (std::size_t i = 0; i < files.frames.size(); ++i) {
    const auto number = in_order ? std::optional(i) : last_number_in(files.frames[i].color.stem().string());
    if (!number || *number >= poses.size()) continue;
    files.frames[i].truth = poses[*number];
    any = true;
  }
  if (in_order) return;
  files.notes.push_back(file.string() + ": contains " + counted(poses.size(), "pose") + " for " +
                        counted(files.frames.size(), "frame") +
                        "; a frame gets the pose of the number in its name, counted from 0" +
                        (any ? "" : ", but no name has the number of a pose: the trajectory is not compared with it"));
}

/// The absolute path without a slash or a dot at its end, so that its last part is the folder's name and its parent the
/// folder that contains it.
fs::path named_folder(const fs::path& source) {
  const fs::path folder = fs::absolute(source).lexically_normal();
  return folder.has_filename() ? folder : folder.parent_path();
}

SequenceFiles find_replica(const SequenceOptions& options) {
  SequenceFiles files;
  files.form = "Replica";
  const fs::path results = options.source / "results";
  const std::vector<fs::path> depths = pictures_in(results, "depth");
  files.frames = paired(pictures_in(results, "frame"), 5, depths, 5);
  files.depth_mismatch = mismatch_of_names(depths, files.frames);
  if (is_file(options.source / "traj.txt")) read_replica_truth(options.source / "traj.txt", files);
  if (options.calibration.empty()) {
    fs::path file = options.source / "cam_params.json";
    if (!is_file(file)) file = named_folder(options.source).parent_path() / "cam_params.json";
    require(is_file(file), options.source.string() + ": has no cam_params.json; give a file with --calibration");
    files.calibration = read_calibration(file);
  }
  return files;
}

/// Lines of "time path".
std::vector<std::pair<double, std::string>> read_tum_list(const fs::path& file) {
  std::ifstream in(file);
  require(in.good(), file.string() + ": cannot be read");
  std::vector<std::pair<double, std::string>> list;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    if (number == 1 && line.starts_with(kByteOrderMark)) line.erase(0, kByteOrderMark.size());
    const std::size_t begin = line.find_first_not_of(" \t\r");
    if (begin == std::string::npos || line[begin] == '#') continue;
    std::istringstream words(line);
    double time = 0;
    std::string path;
    words >> time >> path;
    require(!words.fail() && std::isfinite(time) && !path.starts_with(','),
            file.string() + ":" + std::to_string(number) + ": expected 'time path', separated by a space");
    list.emplace_back(time, path);
  }
  std::ranges::sort(list);
  return list;
}

/// The words of a folder's name in lower case: rgbd_dataset_freiburg1_desk → rgbd, dataset, freiburg1, desk.
std::vector<std::string> words_of(const std::string& name) {
  std::vector<std::string> words(1);
  for (const unsigned char c : name) {
    if (std::isalnum(c)) {
      words.back() += static_cast<char>(std::tolower(c));
    } else {
      words.emplace_back();
    }
  }
  return words;
}

/// The number in a word freiburgN or frN of the folder's name; 0: none.
int freiburg_in(const std::string& name) {
  for (const std::string& word : words_of(name)) {
    for (const int number : {1, 2, 3}) {
      if (word == "freiburg" + std::to_string(number) || word == "fr" + std::to_string(number)) return number;
    }
  }
  return 0;
}

/// Published calibration of a camera of the TUM RGB-D benchmark.
Calibration freiburg_calibration(int number) {
  Calibration c;
  c.width = 640, c.height = 480, c.depth_scale = 5000;
  if (number == 1) {
    c.fx = 517.306408, c.fy = 516.469215, c.cx = 318.643040, c.cy = 255.313989;
    c.k1 = 0.262383, c.k2 = -0.953104, c.p1 = -0.005358, c.p2 = 0.002628, c.k3 = 1.163314;
  } else if (number == 2) {
    c.fx = 520.908620, c.fy = 521.007327, c.cx = 325.141442, c.cy = 249.701764;
    c.k1 = 0.231222, c.k2 = -0.784899, c.p1 = -0.003257, c.p2 = -0.000105, c.k3 = 0.917205;
  } else {
    c.fx = 535.4, c.fy = 539.2, c.cx = 320.1, c.cy = 247.6;
  }
  return c;
}

/// The camera is named by the folder (rgbd_dataset_freiburg1_desk, fr1_desk) or by the one that contains it (fr1/desk).
void choose_freiburg_calibration(const fs::path& source, SequenceFiles& files) {
  const fs::path folder = named_folder(source);
  int number = freiburg_in(folder.filename().string());
  if (number == 0) number = freiburg_in(folder.parent_path().filename().string());
  require(number != 0,
          source.string() +
              ": the camera is unknown: neither this folder's name nor that of the folder that contains it "
              "has a word freiburg1, 2 or 3; give a file with --calibration");
  files.calibration = freiburg_calibration(number);
  files.notes.push_back(source.string() + ": the calibration is that of the TUM benchmark's camera freiburg" +
                        std::to_string(number) + ", by the folder's name; for another give --calibration");
}

SequenceFiles find_tum(const SequenceOptions& options) {
  SequenceFiles files;
  files.form = "TUM RGB-D";
  const auto color = read_tum_list(options.source / "rgb.txt");
  require_own_times(color, options.source / "rgb.txt");
  std::vector<std::pair<double, std::string>> depth;
  if (is_file(options.source / "depth.txt")) depth = read_tum_list(options.source / "depth.txt");
  const auto times_of = [](const auto& list) {
    std::vector<double> times;
    for (const auto& entry : list) times.push_back(entry.first);
    return times;
  };
  const std::vector<double> times = times_of(color);
  const auto depth_of = nearest_in_time(times, times_of(depth), kMaxSecondsApart);
  if (!depth.empty() && std::ranges::none_of(depth_of, [](const auto found) { return found >= 0; })) {
    files.depth_mismatch = (options.source / "depth.txt").string() +
                           ": no depth image belongs to a picture of rgb.txt: their times are more than 20 ms apart; " +
                           kTrackWithoutDepth;
  }
  std::vector<TimedPose> truth;
  const fs::path truth_file = options.source / "groundtruth.txt";
  if (is_file(truth_file)) truth = read_tum_trajectory(truth_file);
  std::ranges::stable_sort(truth, {}, &TimedPose::time);
  std::vector<double> truth_times;
  for (const TimedPose& pose : truth) truth_times.push_back(pose.time);
  const auto truth_of = nearest_in_time(times, truth_times, kMaxSecondsApart);
  if (is_file(truth_file)) note_unused_truth(truth_file, truth_of, files.notes);
  for (std::size_t i = 0; i < color.size(); ++i) {
    FrameFiles frame;
    frame.time = color[i].first;
    frame.name = color[i].second;
    frame.color = options.source / color[i].second;
    if (depth_of[i] >= 0) frame.depth = options.source / depth[static_cast<std::size_t>(depth_of[i])].second;
    if (truth_of[i] >= 0) frame.truth = truth[static_cast<std::size_t>(truth_of[i])].world_from_camera;
    files.frames.push_back(std::move(frame));
  }
  require(!files.frames.empty(), (options.source / "rgb.txt").string() + ": lists no images");
  if (options.calibration.empty()) choose_freiburg_calibration(options.source, files);
  return files;
}

SequenceFiles find_folder(const SequenceOptions& options) {
  SequenceFiles files;
  files.form = "folder of pictures";
  std::vector<fs::path> color;
  for (const char* name : {"images", "rgb", "color", "."}) {
    if (color = pictures_in(options.source / name, ""); !color.empty()) break;
  }
  require(!color.empty() || !is_file(options.source / "cam0" / "data.csv"),
          options.source.string() + ": is a part of an EuRoC sequence; name the folder that contains mav0");
  require(!color.empty(), options.source.string() +
                              ": is not a sequence: no results/frame*.jpg (Replica), no rgb.txt (TUM), no images "
                              "in images/, rgb/, color/ or the folder itself");
  const std::vector<fs::path> depths = pictures_in(options.source / "depth", "");
  files.frames = paired(color, 0, depths, 0);
  files.depth_mismatch = mismatch_of_names(depths, files.frames);
  if (is_file(options.source / "traj.txt")) read_replica_truth(options.source / "traj.txt", files);
  if (options.calibration.empty()) {
    const fs::path file = options.source / "calibration.json";
    require(
        is_file(file) || !fs::is_directory(options.source / "sparse"),
        options.source.string() +
            ": is a COLMAP scene, whose cameras are known: use splatboost train; to track its pictures anyway, give a "
            "file with --calibration");
    require(is_file(file), options.source.string() + ": has no calibration.json; give a file with --calibration");
    files.calibration = read_calibration(file);
  }
  return files;
}

/// Number of frames from the beginning that can be needed; 0: all.
std::size_t last_frame_of(const SequenceOptions& options) {
  const auto first = static_cast<std::size_t>(options.first), count = static_cast<std::size_t>(options.count);
  return count == 0 ? 0 : first + count * static_cast<std::size_t>(options.stride);
}

/// As of a picture, because the stem may contain dots.
std::string name_in_video(const fs::path& video, std::size_t frame) {
  char number[32];
  std::snprintf(number, sizeof(number), "_%06zu.png", frame);
  return video.stem().string() + number;
}

/// A video, which has no depth. Its calibration comes from a file.
SequenceFiles find_video(const SequenceOptions& options) {
  const std::string place = options.source.string();
  const Pixels frame = VideoFrames(options.source).next();
  require(!options.calibration.empty(),
          place + ": a video does not contain the camera's calibration; give a file with --calibration");
  const Calibration c = read_calibration(options.calibration);
  require(frame.width == c.width && frame.height == c.height,
          place + ": has " + std::to_string(frame.width) + "x" + std::to_string(frame.height) + " pixels, but " +
              options.calibration.string() + " has " + std::to_string(c.width) + "x" + std::to_string(c.height));
  const VideoLength video = measure_video(options.source, last_frame_of(options));
  SequenceFiles files;
  files.form = "video";
  for (std::size_t i = 0; i < video.readable; ++i) {
    FrameFiles frame_files;
    frame_files.time = video.times[i];
    frame_files.name = name_in_video(options.source, i);
    frame_files.color = options.source;
    frame_files.video_frame = static_cast<int>(i);
    files.frames.push_back(std::move(frame_files));
  }
  if (last_frame_of(options) == 0 && video.readable < video.claimed) {
    files.notes.push_back(place + ": claims " + counted(video.claimed, "frame") + ", of which " +
                          std::to_string(video.readable) + " can be read");
  }
  return files;
}

/// Throws InputError, beginning with `where`, if the object has another key.
void require_known_keys(const Json& json, const std::vector<std::string>& known, const std::string& where) {
  for (const auto& [key, value] : json.items()) {
    if (std::ranges::find(known, key) != known.end()) continue;
    std::string names;
    for (const std::string& name : known) names += (names.empty() ? "" : ", ") + name;
    throw InputError(where + ": unknown key '" + key + "'; known: " + names);
  }
}

void require_calibration_keys(const Json& json, const std::string& where) {
  std::vector<std::string> known(std::begin(kCalibrationKeys), std::end(kCalibrationKeys));
  for (const auto& [name, synonym] : kSynonyms) known.emplace_back(synonym);
  Json supported = json;
  for (const char* key : kUnsupportedKeys) supported.erase(key);  // with a message of their own
  require_known_keys(supported, known, where);
  for (const auto& [name, synonym] : kSynonyms) {
    const bool contradicts = json.contains(name) && json.contains(synonym) && json.at(name) != json.at(synonym);
    require(!contradicts, where + ": '" + name + "' and '" + synonym +
                              "' mean the same, but have different values; remove one of them");
  }
}

/// Share of the undistorted image that is inside the distorted one.
double visible_share(const Calibration& c) {
  const DistortedPlaces places(c);
  int visible = 0;
  for (int row = 0; row < kSampledSide; ++row) {
    for (int column = 0; column < kSampledSide; ++column) {
      const auto place = places.of((column + 0.5) / kSampledSide * c.width, (row + 0.5) / kSampledSide * c.height);
      visible += place && place->x >= 0 && place->y >= 0 && place->x <= c.width && place->y <= c.height ? 1 : 0;
    }
  }
  return static_cast<double>(visible) / (kSampledSide * kSampledSide);
}

}  // namespace

void note_unused_truth(const fs::path& file, std::span<const std::ptrdiff_t> of_pictures,
                       std::vector<std::string>& notes) {
  if (std::ranges::any_of(of_pictures, [](std::ptrdiff_t pose) { return pose >= 0; })) return;
  notes.push_back(file.string() + ": no pose within 20 ms of a picture; the trajectory is not compared with it");
}

DistortedPlaces::DistortedPlaces(const Calibration& c)
    : calibration_(c),
      model_{c.k1, c.k2, c.k3, c.p1, c.p2},
      fold_(model_.fold_radius(
          std::hypot(std::max(c.cx, c.width - c.cx) / c.fx, std::max(c.cy, c.height - c.cy) / c.fy))) {}

std::optional<glm::dvec2> DistortedPlaces::of(double column, double row) const {
  const Calibration& c = calibration_;
  const glm::dvec2 point((column - c.cx) / c.fx, (row - c.cy) / c.fy);
  if (glm::length(point) > fold_) return std::nullopt;
  const glm::dvec2 shown = model_.distort(point);
  return glm::dvec2(c.fx * shown.x + c.cx, c.fy * shown.y + c.cy);
}

Calibration read_calibration(const fs::path& file) {
  Json json = read_json_file(file);
  if (json.contains("camera")) {
    require_known_keys(json, {"camera"}, file.string() + ": beside 'camera'");
    json = Json(json.at("camera"));
  }
  require(json.is_object(), file.string() + ": camera must be an object");
  require_calibration_keys(json, file.string());
  Calibration c;
  const auto read = [&](const char* name, const char* other, auto& value, bool needed) {
    const char* const key = json.contains(name) ? name : other;
    if (json.contains(key)) return read_value(json.at(key), file.string() + ": " + key, value);
    require(!needed, file.string() + ": has no '" + name + "'");
  };
  read("width", "w", c.width, true);
  read("height", "h", c.height, true);
  read("fx", "fx", c.fx, true);
  read("fy", "fy", c.fy, true);
  read("cx", "cx", c.cx, true);
  read("cy", "cy", c.cy, true);
  read("k1", "k1", c.k1, false);
  read("k2", "k2", c.k2, false);
  read("p1", "p1", c.p1, false);
  read("p2", "p2", c.p2, false);
  read("k3", "k3", c.k3, false);
  for (const char* unsupported : kUnsupportedKeys) {
    double value = 0;
    read(unsupported, unsupported, value, false);
    require(value == 0, file.string() + ": " + unsupported +
                            " is not supported, only the distortion k1, k2, p1, p2, k3; undistort the images");
  }
  read("depth_scale", "scale", c.depth_scale, false);
  check_calibration(c, file.string());
  return c;
}

void check_calibration(const Calibration& c, const std::string& where) {
  const auto [smallest, largest] = std::minmax(c.width, c.height);
  require(smallest >= kSmallestSide && largest <= kLargestSide,
          where + ": the image size " + std::to_string(c.width) + "x" + std::to_string(c.height) +
              " is out of range: width and height must be " + std::to_string(kSmallestSide) + " to " +
              std::to_string(kLargestSide) + " px; use pictures of such a size, with their calibration");
  require(std::isfinite(c.fx) && std::isfinite(c.fy) && c.fx > 0 && c.fy > 0,
          where + ": focal lengths must be above 0");
  require(c.fx > 0.05 * c.width && c.fx < 50 * c.width && c.fy > 0.05 * c.height && c.fy < 50 * c.height,
          where + ": the focal lengths do not match the image size; both are in pixels");
  require(c.cx >= 0 && c.cx <= c.width && c.cy >= 0 && c.cy <= c.height,
          where + ": the principal point is outside the image");
  require(std::isfinite(c.k1 + c.k2 + c.p1 + c.p2 + c.k3), where + ": distortion must be finite");
  const double visible = visible_share(c);
  require(visible >= kLeastVisible, where + ": the distortion k1, k2, p1, p2, k3 moves " +
                                        std::to_string(std::lround(100 * (1 - visible))) +
                                        " % of a picture out of sight; check the signs and sizes of its coefficients");
  require(std::isfinite(c.depth_scale) && c.depth_scale >= 0, where + ": depth_scale must be 0 or more");
}

SequenceFiles find_sequence_files(const SequenceOptions& options) {
  std::error_code error;
  const fs::path& source = options.source;
  require(fs::exists(source, error), source.string() + ": no such file or folder");
  const bool video = !fs::is_directory(source, error);
  SequenceFiles files = video                                               ? find_video(options)
                        : fs::is_directory(source / "mav0", error)          ? find_euroc(source)
                        : !pictures_in(source / "results", "frame").empty() ? find_replica(options)
                        : is_file(source / "rgb.txt")                       ? find_tum(options)
                                                                            : find_folder(options);
  const bool pairs = files.stereo.has_value();
  require(!pairs || options.calibration.empty(),
          source.string() +
              ": stereo cameras are read from mav0/cam0/sensor.yaml and "
              "mav0/cam1/sensor.yaml; omit --calibration, which is for one camera");
  if (!options.calibration.empty()) files.calibration = read_calibration(options.calibration);
  for (const FrameFiles& frame : files.frames) {  // names go into JSON results
    require(is_utf8(frame.name), source.string() + ": the name of the image '" + frame.name +
                                     "' is not UTF-8; rename the image file, and its entry if the sequence lists it");
  }
  const std::size_t total = files.frames.size();
  std::vector<FrameFiles> chosen;
  for (std::size_t i = static_cast<std::size_t>(options.first); i < total;
       i += static_cast<std::size_t>(options.stride)) {
    if (options.count > 0 && chosen.size() == static_cast<std::size_t>(options.count)) break;
    chosen.push_back(std::move(files.frames[i]));
  }
  require(!chosen.empty(), source.string() + ": has " + counted(total, "frame") + ", none of them from frame " +
                               std::to_string(options.first) + " onwards");
  files.frames = std::move(chosen);
  const auto without = std::ranges::count_if(files.frames, [](const FrameFiles& f) { return f.depth.empty(); });
  if (static_cast<std::size_t>(without) == files.frames.size()) {
    require(!pairs, source.string() +
                        ": no image of mav0/cam1 belongs to one of mav0/cam0: their times in data.csv are more than "
                        "5 ms apart");
    require(files.depth_mismatch.empty() || !files.calibration.has_depth(), files.depth_mismatch);
    files.calibration.depth_scale = 0;  // colour alone, whatever the calibration says
  } else if (without > 0) {
    files.notes.push_back(std::to_string(without) + " of " + std::to_string(files.frames.size()) +
                          (without == 1 ? " frames has " : " frames have ") + (pairs ? "no second image" : "no depth") +
                          "; without it a frame can only be tracked by colour");
  }
  return files;
}

}  // namespace splatboost
