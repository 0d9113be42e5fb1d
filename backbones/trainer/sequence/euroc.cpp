// SPDX-License-Identifier: Apache-2.0
#include "trainer/sequence/euroc.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <fstream>
#include <functional>
#include <iterator>
#include <utility>

#include <glm/gtc/quaternion.hpp>

#include "trainer/sequence/trajectory.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

namespace fs = std::filesystem;

constexpr double kMaxSecondsApart = 0.005;   ///< between the images of a pair
constexpr double kMaxSecondsToTruth = 0.02;  ///< between an image and its true pose

/// Comma-separated fields of a line, without blanks.
std::vector<std::string> fields_of(const std::string& line) {
  std::vector<std::string> fields(1);
  for (const char c : line) {
    if (c == ',') {
      fields.emplace_back();
    } else if (c != ' ' && c != '\r' && c != '\t') {
      fields.back() += c;
    }
  }
  return fields;
}

double number_of(const std::string& text, const std::string& where) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  require(error == std::errc() && end == text.data() + text.size() && std::isfinite(value),
          where + ": '" + text + "' is not a number");
  return value;
}

/// Calls row(fields, where) for each line that is not a comment.
template <class Row>
void read_csv(const fs::path& file, std::size_t fields, const Row& row) {
  std::ifstream in(file);
  require(in.good(), file.string() + ": cannot be read");
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    const std::size_t begin = line.find_first_not_of(" \t\r");
    if (begin == std::string::npos || line[begin] == '#') continue;
    const std::string where = file.string() + ":" + std::to_string(number);
    const std::vector<std::string> found = fields_of(line);
    require(found.size() >= fields, where + ": expected " + std::to_string(fields) + " comma-separated fields");
    row(found, where);
  }
}

double seconds_of(const std::string& nanoseconds, const std::string& where) {
  return number_of(nanoseconds, where) * 1e-9;
}

/// The numbers in the brackets that follow `key:` (after `inside:`, if that is given) in sensor.yaml.
std::vector<double> list_of(const std::string& text, const std::string& inside, const std::string& key,
                            std::size_t count, const fs::path& file) {
  const std::string where = file.string() + ": " + key;
  const auto find = [&](const std::string& name, std::size_t from) {
    for (std::size_t at = text.find(name + ":", from); at != std::string::npos; at = text.find(name + ":", at + 1)) {
      if (at == 0 || text[at - 1] == '\n' || text[at - 1] == ' ') return at;
    }
    throw InputError(file.string() + ": has no '" + name + "'");
  };
  const std::size_t found = find(key, inside.empty() ? 0 : find(inside, 0)) + key.size() + 1;
  const std::size_t begin = text.find_first_not_of(" \t\r\n", found);
  const std::size_t end = text.find(']', found);
  require(begin != std::string::npos && text[begin] == '[' && end != std::string::npos,
          where + ": expected numbers in brackets");
  std::string line;
  for (const char c : text.substr(begin + 1, end - begin - 1)) {
    if (c != '\n') line += c;
  }
  std::vector<double> numbers;
  for (const std::string& field : fields_of(line)) numbers.push_back(number_of(field, where));
  require(numbers.size() == count, where + ": expected " + std::to_string(count) + " numbers");
  return numbers;
}

struct EurocCamera {
  Calibration calibration;
  glm::dmat4 body_from_camera{1.0};
};

/// If the file names a model, its name must start with `beginning`: other models would be rectified wrongly.
void require_model(const std::string& text, const std::string& key, const std::string& beginning,
                   const fs::path& file) {
  const std::size_t at = text.find(key);
  if (at == std::string::npos) return;
  const std::size_t begin = text.find_first_not_of(" \t\"'", at + key.size());
  require(begin != std::string::npos && text.compare(begin, beginning.size(), beginning) == 0,
          file.string() + ": " + key + " this model is not supported; undistort the images, and use pinhole with " +
              "radial-tangential");
}

EurocCamera read_camera(const fs::path& file) {
  std::ifstream in(file);
  require(in.good(), file.string() + ": cannot be read");
  std::string text;
  for (std::string line; std::getline(in, line);) text += line.substr(0, line.find('#')) + "\n";
  EurocCamera camera;
  Calibration& c = camera.calibration;
  require_model(text, "camera_model:", "pinhole", file);
  require_model(text, "distortion_model:", "rad", file);  // radial-tangential, or radtan
  const std::vector<double> size = list_of(text, "", "resolution", 2, file);
  c.width = static_cast<int>(std::clamp(size[0], 0.0, 1e6));
  c.height = static_cast<int>(std::clamp(size[1], 0.0, 1e6));
  const std::vector<double> intrinsics = list_of(text, "", "intrinsics", 4, file);
  c.fx = intrinsics[0], c.fy = intrinsics[1], c.cx = intrinsics[2], c.cy = intrinsics[3];
  const std::vector<double> distortion = list_of(text, "", "distortion_coefficients", 4, file);
  c.k1 = distortion[0], c.k2 = distortion[1], c.p1 = distortion[2], c.p2 = distortion[3];
  check_calibration(c, file.string());
  const std::vector<double> pose = list_of(text, "T_BS", "data", 16, file);
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) {
      camera.body_from_camera[column][row] = pose[static_cast<std::size_t>(4 * row + column)];
    }
  }
  require(is_rigid(camera.body_from_camera), file.string() + ": T_BS is not a rigid transform");
  return camera;
}

std::vector<std::pair<double, fs::path>> read_pictures(const fs::path& camera) {
  std::vector<std::pair<double, fs::path>> pictures;
  read_csv(camera / "data.csv", 2, [&](const std::vector<std::string>& fields, const std::string& where) {
    pictures.emplace_back(seconds_of(fields[0], where), camera / "data" / fields[1]);
  });
  require(!pictures.empty(), (camera / "data.csv").string() + ": lists no images");
  std::ranges::sort(pictures);
  require_own_times(pictures, camera / "data.csv");
  return pictures;
}

/// world_from_body, ascending in time.
std::vector<TimedPose> read_truth(const fs::path& file) {
  std::vector<TimedPose> poses;
  read_csv(file, 8, [&](const std::vector<std::string>& fields, const std::string& where) {
    double v[7];
    for (std::size_t i = 0; i < 7; ++i) v[i] = number_of(fields[i + 1], where);
    const glm::dquat q(v[3], v[4], v[5], v[6]);
    require(glm::length(q) > 0.5, where + ": the rotation is not a quaternion of length 1");
    TimedPose pose{seconds_of(fields[0], where), glm::mat4_cast(glm::normalize(q))};
    pose.world_from_camera[3] = glm::dvec4(v[0], v[1], v[2], 1);
    poses.push_back(pose);
  });
  std::ranges::sort(poses, {}, &TimedPose::time);
  return poses;
}

std::vector<double> times_of(const auto& list, const auto& time) {
  std::vector<double> times;
  for (const auto& entry : list) times.push_back(std::invoke(time, entry));
  return times;
}

}  // namespace

SequenceFiles find_euroc(const fs::path& source) {
  const fs::path mav = source / "mav0";
  SequenceFiles files;
  files.form = "EuRoC";
  const EurocCamera left = read_camera(mav / "cam0" / "sensor.yaml");
  files.calibration = left.calibration;
  const auto pictures = read_pictures(mav / "cam0");
  std::vector<std::pair<double, fs::path>> others;
  if (fs::exists(mav / "cam1")) {
    const EurocCamera right = read_camera(mav / "cam1" / "sensor.yaml");
    require(left.calibration.width == right.calibration.width && left.calibration.height == right.calibration.height,
            (mav / "cam1" / "sensor.yaml").string() + ": the two cameras have different image sizes");
    files.stereo =
        StereoRig{left.calibration, right.calibration, glm::inverse(right.body_from_camera) * left.body_from_camera,
                  (mav / "cam1" / "sensor.yaml").string()};
    others = read_pictures(mav / "cam1");
  } else {
    files.notes.push_back(source.string() + ": has no mav0/cam1; mav0/cam0 is tracked alone");
  }
  const auto first = &std::pair<double, fs::path>::first;
  const std::vector<double> times = times_of(pictures, first);
  const auto other_of = nearest_in_time(times, times_of(others, first), kMaxSecondsApart);
  std::vector<TimedPose> truth;
  const fs::path truth_file = mav / "state_groundtruth_estimate0" / "data.csv";
  if (is_file(truth_file)) truth = read_truth(truth_file);
  const auto truth_of = nearest_in_time(times, times_of(truth, &TimedPose::time), kMaxSecondsToTruth);
  if (is_file(truth_file)) note_unused_truth(truth_file, truth_of, files.notes);
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    FrameFiles frame;
    frame.time = pictures[i].first;
    frame.name = pictures[i].second.filename().string();
    frame.color = pictures[i].second;
    if (other_of[i] >= 0) frame.depth = others[static_cast<std::size_t>(other_of[i])].second;
    if (truth_of[i] >= 0) {
      frame.truth = truth[static_cast<std::size_t>(truth_of[i])].world_from_camera * left.body_from_camera;
    }
    files.frames.push_back(std::move(frame));
  }
  return files;
}

}  // namespace splatboost
