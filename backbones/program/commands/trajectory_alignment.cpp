// SPDX-License-Identifier: Apache-2.0
#include "program/commands/trajectory_alignment.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <optional>
#include <string>
#include <vector>

#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>
#include <nlohmann/json.hpp>

#include "trainer/formats/colmap.h"
#include "trainer/formats/frame_times.h"
#include "trainer/sequence/trajectory.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_values.h"
#include "trainer/support/text.h"

namespace splatboost::program {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMinCameras = 3;
constexpr double kLine = 1e-3;  // of its length: positions that are nearer to a line do not determine a rotation

struct NamedPosition {
  std::string name;
  glm::dvec3 position{0.0};
};

std::vector<NamedPosition> positions_in_json(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  require(stream.good(), file.string() + ": cannot be read");
  const nlohmann::json cameras = parse_json(std::string(std::istreambuf_iterator<char>(stream), {}), file.string());
  require(cameras.is_array(), file.string() + ": must hold a list of cameras");
  std::vector<NamedPosition> found;
  for (const nlohmann::json& camera : cameras) {
    const std::string place = file.string() + ": camera " + std::to_string(found.size());
    require(camera.is_object() && camera.contains("img_name") && camera.contains("position"),
            place + " needs img_name and position");
    NamedPosition& named = found.emplace_back();
    std::vector<double> position;
    read_value(camera["img_name"], place + ": img_name", named.name);
    read_value(camera["position"], place + ": position", position);
    require(position.size() == 3, place + ": position must be three numbers");
    named.position = {position[0], position[1], position[2]};
  }
  return found;
}

std::vector<NamedPosition> positions_in_colmap(const fs::path& folder) {
  std::vector<NamedPosition> found;
  for (const ColmapImage& image : read_colmap_model(folder).images) {
    const double* q = image.rotation;
    const glm::dmat3 camera_from_world(glm::normalize(glm::dquat(q[0], q[1], q[2], q[3])));
    const glm::dvec3 translation(image.translation[0], image.translation[1], image.translation[2]);
    found.push_back({image.name, -(glm::transpose(camera_from_world) * translation)});
    const glm::dvec3& at = found.back().position;
    require(std::isfinite(at.x + at.y + at.z), folder.string() + ": image '" + image.name + "' has no usable pose");
  }
  return found;
}

std::vector<NamedPosition> camera_positions(const fs::path& path) {
  std::error_code ignored;
  if (!fs::is_directory(path, ignored)) return positions_in_json(path);
  if (fs::exists(path / "cameras.json", ignored)) return positions_in_json(path / "cameras.json");
  return positions_in_colmap(find_colmap_model(path).value_or(path));
}

bool on_a_line(const std::vector<glm::dvec3>& positions) {
  const glm::dvec3 first = positions.front();
  const auto farther = [&](const glm::dvec3& a, const glm::dvec3& b) {
    return glm::length(a - first) < glm::length(b - first);
  };
  const glm::dvec3 way = *std::max_element(positions.begin(), positions.end(), farther) - first;
  const double length = glm::length(way);
  return std::all_of(positions.begin(), positions.end(), [&](const glm::dvec3& position) {
    return glm::length(glm::cross(position - first, way)) <= kLine * length * length;
  });
}

}  // namespace

TrajectoryAlignment align_to_trajectory(const fs::path& cameras, const fs::path& trajectory) {
  std::vector<NamedPosition> named = camera_positions(cameras);
  std::sort(named.begin(), named.end(),
            [](const NamedPosition& a, const NamedPosition& b) { return in_number_order(a.name, b.name); });
  const std::vector<glm::dvec3> poses = read_log_positions(trajectory);
  std::vector<glm::dvec3> from, to;
  for (std::size_t i = 0; i < named.size(); ++i) {
    std::size_t pose = i;
    if (named.size() != poses.size()) {
      const std::int64_t number = frame_number(named[i].name);
      require(number >= 1 && static_cast<std::uint64_t>(number) <= poses.size(),
              cameras.string() + ": image '" + named[i].name + "' has no pose in " + trajectory.string() +
                  ", which has those of images 1 to " + std::to_string(poses.size()));
      pose = static_cast<std::size_t>(number - 1);
    }
    from.push_back(named[i].position);
    to.push_back(poses[pose]);
  }
  require(from.size() >= kMinCameras && !on_a_line(from) && !on_a_line(to),
          cameras.string() + ": an alignment needs three cameras with poses in " + trajectory.string() +
              ", not all on one line");
  TrajectoryAlignment result;
  const Alignment found = align_most(from, to, &result.cameras);
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column) {
      result.transform[static_cast<std::size_t>(4 * row + column)] = found.to_from[column][row];
    }
  }
  result.scale = found.scale;
  result.rmse = found.rmse;
  result.left_out = from.size() - result.cameras;
  return result;
}

}  // namespace splatboost::program
