// SPDX-License-Identifier: Apache-2.0
#include "trainer/formats/nerfies.h"

#include <algorithm>
#include <cmath>

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>
#include <nlohmann/json.hpp>

#include "trainer/formats/npy.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"
#include "trainer/support/json_values.h"

namespace splatboost {
namespace {

using Json = nlohmann::json;
namespace fs = std::filesystem;

template <class T>
T take(const Json& object, const std::string& where, const char* key) {
  T value{};
  const std::string place = where + ": '" + key + "'";
  require(object.is_object() && object.contains(key), place + " is missing");
  read_value(object[key], place, value);
  return value;
}

template <class T>
T take_or(const Json& object, const std::string& where, const char* key, const T& otherwise) {
  return object.contains(key) ? take<T>(object, where, key) : otherwise;
}

/// Transform from the capture's world to the world used in training: (x − center)·scale.
struct World {
  glm::dvec3 center{0};
  double scale = 1;
  glm::dvec3 apply(const glm::dvec3& x) const { return (x - center) * scale; }
};

World read_world(const fs::path& file) {
  const Json json = read_json_file(file);
  World world;
  const auto center = take<std::vector<double>>(json, file, "center");
  require(center.size() == 3, file.string() + ": 'center' must hold three numbers");
  world.center = {center[0], center[1], center[2]};
  world.scale = take<double>(json, file, "scale");
  require(world.scale > 0, file.string() + ": 'scale' must be above 0");
  return world;
}

std::vector<double> take_numbers(const Json& json, const fs::path& file, const char* key, std::size_t count) {
  auto numbers = take<std::vector<double>>(json, file, key);
  require(numbers.size() == count, file.string() + ": '" + key + "' must hold " + std::to_string(count) + " numbers");
  return numbers;
}

void read_camera(const fs::path& file, const World& world, Photo& photo) {
  const Json json = read_json_file(file);
  Lens& lens = photo.lens;
  lens.fx = take<double>(json, file, "focal_length");
  lens.fy = lens.fx * take_or(json, file, "pixel_aspect_ratio", 1.0);
  const std::vector<double> middle = take_numbers(json, file, "principal_point", 2),
                            size = take_numbers(json, file, "image_size", 2),
                            position = take_numbers(json, file, "position", 3);
  lens.cx = middle[0];
  lens.cy = middle[1];
  require(size[0] >= 1 && size[1] >= 1 && size[0] <= 1 << 20 && size[1] <= 1 << 20,
          file.string() + ": 'image_size' is out of range");
  lens.width = static_cast<int>(size[0]);
  lens.height = static_cast<int>(size[1]);
  require(std::abs(take_or(json, file, "skew", 0.0)) < 1e-6,
          file.string() + ": cameras with skewed pixels are not supported");
  if (json.contains("radial_distortion")) {
    const std::vector<double> k = take_numbers(json, file, "radial_distortion", 3);
    lens.k1 = k[0];
    lens.k2 = k[1];
    lens.k3 = k[2];
  }
  // Some files use the shorter key.
  for (const char* key : {"tangential_distortion", "tangential"}) {
    if (!json.contains(key)) continue;
    const std::vector<double> p = take_numbers(json, file, key, 2);
    lens.p1 = p[0];
    lens.p2 = p[1];
  }
  check_lens(lens, file.string());

  // Rows are the camera's axes: x right, y down, z forward.
  const auto rows = take<std::vector<std::vector<double>>>(json, file, "orientation");
  const bool square = rows.size() == 3 && std::ranges::all_of(rows, [](const auto& row) { return row.size() == 3; });
  require(square, file.string() + ": 'orientation' is not a 3x3 matrix");
  glm::dmat3 rotation(1);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      rotation[column][row] = rows[static_cast<std::size_t>(row)][static_cast<std::size_t>(column)];
    }
  }
  const glm::dmat3 product = glm::transpose(rotation) * rotation;
  for (int column = 0; column < 3; ++column) {
    for (int row = 0; row < 3; ++row) {
      require(std::abs(product[column][row] - (row == column ? 1.0 : 0.0)) < 1e-2 && glm::determinant(rotation) > 0,
              file.string() + ": 'orientation' is not a rotation");
    }
  }
  const glm::dvec3 centre = world.apply({position[0], position[1], position[2]});
  photo.camera_from_world = glm::dmat4(rotation);
  photo.camera_from_world[3] = glm::dvec4(-(rotation * centre), 1.0);
}

}  // namespace

bool is_nerfies_capture(const fs::path& folder) {
  std::error_code ignored;
  return is_file(folder / "dataset.json") && is_file(folder / "metadata.json") &&
         fs::is_directory(folder / "camera", ignored);
}

NerfiesCapture read_nerfies(const fs::path& folder, const std::string& images) {
  std::error_code ignored;
  require(fs::is_directory(folder / images, ignored),
          (folder / images).string() + ": the image folder does not exist; name the right one with --images");
  const World world = read_world(folder / "scene.json");
  const fs::path listing = folder / "dataset.json", metadata_file = folder / "metadata.json";
  const Json dataset = read_json_file(listing), metadata = read_json_file(metadata_file);
  using Names = std::vector<std::string>;
  auto train = take_or<Names>(dataset, listing, "train_ids", {}),
       test = take_or<Names>(dataset, listing, "val_ids", {});
  if (test.empty()) {
    const auto all = take<Names>(dataset, listing, "ids");
    train.clear();
    for (std::size_t i = 0; i < all.size(); i += 4) train.push_back(all[i]);
    for (std::size_t i = 2; i < all.size(); i += 4) test.push_back(all[i]);
  }
  require(!train.empty(), listing.string() + ": lists no images");

  NerfiesCapture capture;
  capture.test = test.size();
  Names all = train;
  all.insert(all.end(), test.begin(), test.end());
  std::vector<double> times;
  for (const std::string& id : all) {
    const bool plain = !id.empty() && id.find('/') == std::string::npos && id.find('\0') == std::string::npos;
    require(plain, listing.string() + ": '" + id + "' is not the name of an image");
    Photo photo;
    photo.name = id + ".png";
    photo.file = folder / images / photo.name;
    photo.listed_in = listing;
    read_camera(folder / "camera" / (id + ".json"), world, photo);
    require(metadata.contains(id), metadata_file.string() + ": has no entry for image '" + id + "'");
    const Json& of_photo = metadata[id];
    // Nerfies itself calls the time index warp_id, after its use.
    const char* key = of_photo.contains("time_id") ? "time_id" : "warp_id";
    times.push_back(
        static_cast<double>(take<std::int64_t>(of_photo, metadata_file.string() + ": image '" + id + "'", key)));
    capture.photos.push_back(std::move(photo));
  }
  const auto [first, last] = std::ranges::minmax(times);
  for (std::size_t i = 0; i < times.size(); ++i) {
    capture.photos[i].time = last > first ? (times[i] - first) / (last - first) : 0;
  }

  if (const fs::path file = folder / "points.npy"; is_file(file)) {
    const NpyArray points = read_npy(file);
    require(points.shape.size() == 2 && points.shape[1] == 3, file.string() + ": is not a list of points [N,3]");
    for (std::size_t i = 0; i < points.values.size(); i += 3) {
      const glm::dvec3 at = world.apply({points.values[i], points.values[i + 1], points.values[i + 2]});
      for (int axis = 0; axis < 3; ++axis) capture.points.positions.push_back(static_cast<float>(at[axis]));
    }
    capture.points.colors.assign(capture.points.positions.size(), 128);
  }
  return capture;
}

}  // namespace splatboost
