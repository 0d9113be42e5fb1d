// SPDX-License-Identifier: Apache-2.0
#include "trainer/formats/transforms.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <string>

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>
#include <nlohmann/json.hpp>

#include "trainer/support/input_error.h"
#include "trainer/support/json_values.h"

namespace splatboost {
namespace {

using Json = nlohmann::json;

/// A JSON object and its location, for error messages.
struct Place {
  const Json& json;
  std::string where;

  [[noreturn]] void fail(const std::string& cause) const { throw InputError(where + ": " + cause); }

  std::optional<double> number(const char* key) const {
    const auto found = json.find(key);
    if (found == json.end()) return std::nullopt;
    if (!found->is_number()) fail(std::string("'") + key + "' is not a number");
    const double value = found->get<double>();
    if (!std::isfinite(value)) fail(std::string("'") + key + "' is not finite");
    return value;
  }

  std::optional<std::string> text(const char* key) const {
    const auto found = json.find(key);
    if (found == json.end()) return std::nullopt;
    if (!found->is_string()) fail(std::string("'") + key + "' is not a string");
    return found->get<std::string>();
  }
};

constexpr std::array kFocalKeys{"fl_x", "fl_y", "camera_angle_x", "camera_angle_y"};

/// Overwrites the intrinsics in `lens` that `place` has.
void read_lens(const Place& place, Lens& lens) {
  // They describe one lens: a shared fl_y does not belong to a frame's own fl_x.
  if (std::ranges::any_of(kFocalKeys, [&](const char* key) { return place.json.contains(key); })) {
    lens.fx = lens.fy = lens.angle_x = lens.angle_y = 0;
  }
  const auto set = [&](const char* key, double& value) {
    if (const auto given = place.number(key)) value = *given;
  };
  const auto set_size = [&](const char* key, int& value) {
    const auto given = place.number(key);
    if (!given) return;
    if (!(*given >= 1 && *given <= 1 << 20)) place.fail(std::string("'") + key + "' is not a valid image size");
    value = static_cast<int>(std::lround(*given));
  };
  const auto set_focal = [&](const char* key, double& value) {
    const auto given = place.number(key);
    if (!given) return;
    if (!(*given > 0)) place.fail(std::string("the focal length '") + key + "' must be above zero");
    value = *given;
  };
  set_size("w", lens.width);
  set_size("h", lens.height);
  set_focal("fl_x", lens.fx);
  set_focal("fl_y", lens.fy);
  set("camera_angle_x", lens.angle_x);
  set("camera_angle_y", lens.angle_y);
  if (const auto cx = place.number("cx")) lens.cx = cx;
  if (const auto cy = place.number("cy")) lens.cy = cy;
  set("k1", lens.k1);
  set("k2", lens.k2);
  set("k3", lens.k3);
  set("p1", lens.p1);
  set("p2", lens.p2);
  if (place.number("k4").value_or(0) != 0)
    place.fail("the distortion 'k4' is not supported; undistort the photos first");

  constexpr std::array kModels{"PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"};
  const auto model = place.text("camera_model");
  if (model && std::ranges::none_of(kModels, [&](const char* known) { return *model == known; })) {
    place.fail("the camera_model " + *model +
               " is not supported (supported: PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, "
               "RADIAL, OPENCV); undistort the photos first");
  }
  const auto fisheye = place.json.find("is_fisheye");
  if (fisheye != place.json.end() && !fisheye->is_boolean()) place.fail("is_fisheye must be true or false");
  if (fisheye != place.json.end() && *fisheye == true)
    place.fail("fisheye cameras are not supported; undistort the photos first");
}

glm::dmat4 read_pose(const Place& frame) {
  const auto found = frame.json.find("transform_matrix");
  if (found == frame.json.end()) frame.fail("has no 'transform_matrix'");
  const Json& rows = *found;
  const auto fail_shape = [&] { frame.fail("'transform_matrix' is not a 4x4 matrix of numbers"); };
  if (!rows.is_array() || rows.size() < 3 || rows.size() > 4) fail_shape();
  glm::dmat4 world_from_camera(1.0);
  for (int row = 0; row < static_cast<int>(rows.size()); ++row) {
    const Json& values = rows[static_cast<std::size_t>(row)];
    if (!values.is_array() || values.size() != 4) fail_shape();
    for (int column = 0; column < 4; ++column) {
      const Json& value = values[static_cast<std::size_t>(column)];
      if (!value.is_number()) fail_shape();
      world_from_camera[column][row] = value.get<double>();
      if (!std::isfinite(world_from_camera[column][row])) frame.fail("'transform_matrix' is not finite");
    }
  }

  for (int column = 0; column < 4; ++column) {
    if (std::abs(world_from_camera[column][3] - (column == 3 ? 1.0 : 0.0)) < 1e-2) continue;
    frame.fail(
        "'transform_matrix' does not end with the row 0 0 0 1; it must be camera to world, row by row (is it "
        "transposed?)");
  }

  // Rounding errors and a scale, which some tools leave in the rotation, are removed; anything else is an error.
  glm::dmat3 rotation(world_from_camera);
  const double volume = glm::determinant(rotation);
  if (!(volume > 0)) frame.fail("'transform_matrix' contains no rotation (its determinant is not positive)");
  rotation /= std::cbrt(volume);
  const glm::dmat3 product = glm::transpose(rotation) * rotation;
  for (int column = 0; column < 3; ++column) {
    for (int row = 0; row < 3; ++row) {
      if (!(std::abs(product[column][row] - (row == column ? 1.0 : 0.0)) < 1e-2)) {
        frame.fail("'transform_matrix' contains no rotation (its axes are not orthogonal and of equal length)");
      }
    }
  }
  rotation[0] = glm::normalize(rotation[0]);
  rotation[1] = glm::normalize(rotation[1] - glm::dot(rotation[0], rotation[1]) * rotation[0]);
  rotation[2] = glm::cross(rotation[0], rotation[1]);

  // OpenGL looks along -z with y up, we look along +z with y down.
  rotation[1] = -rotation[1];
  rotation[2] = -rotation[2];
  const glm::dmat3 inverse = glm::transpose(rotation);
  glm::dmat4 camera_from_world(inverse);
  camera_from_world[3] = glm::dvec4(-(inverse * glm::dvec3(world_from_camera[3])), 1.0);
  return camera_from_world;
}

/// The image file of a frame; Blender's files omit the extension.
std::filesystem::path image_file(const std::filesystem::path& folder, const std::filesystem::path& listed) {
  std::filesystem::path whole = folder / listed;
  std::error_code ignored;
  if (std::filesystem::is_regular_file(whole, ignored)) return whole;
  for (const char* extension : {".png", ".jpg", ".jpeg", ".PNG", ".JPG"}) {
    std::filesystem::path file = whole;
    file += extension;
    if (std::filesystem::is_regular_file(file, ignored)) return file;
  }
  // No such file; load_view() reports the most likely name.
  std::filesystem::path likely = whole;
  if (!likely.has_extension()) likely += ".png";
  return likely;
}

/// A list of frames, such as nerfstudio's train_filenames.
/// @return for each photo, whether it is listed; empty if there is no such list
std::vector<bool> read_split(const Place& top, const char* key, const std::filesystem::path& folder,
                             const std::vector<Photo>& photos) {
  const auto found = top.json.find(key);
  if (found == top.json.end() || found->empty()) return {};
  std::map<std::filesystem::path, std::vector<std::size_t>> photos_of;  // a picture may have several times
  for (std::size_t i = 0; i < photos.size(); ++i) photos_of[photos[i].file].push_back(i);
  std::vector<bool> listed(photos.size(), false);
  for (const Json& name : *found) {
    if (!found->is_array() || !name.is_string()) top.fail(std::string("'") + key + "' is not a list of strings");
    const auto of_file = photos_of.find(image_file(folder, name.get<std::string>()).lexically_normal());
    if (of_file == photos_of.end()) {
      top.fail(std::string("'") + key + "' lists '" + name.get<std::string>() +
               "', which is the file_path of no frame; correct it or remove it from the list");
    }
    for (const std::size_t i : of_file->second) listed[i] = true;
  }
  return listed;
}

}  // namespace

Transforms read_transforms(const std::filesystem::path& file) {
  const Json json = read_json_file(file);
  const Place top{json, file.string()};
  const auto frames = json.find("frames");
  if (frames == json.end() || !frames->is_array()) top.fail("has no list 'frames'");
  if (frames->empty()) top.fail("lists no frames");

  Lens shared;
  read_lens(top, shared);

  Transforms result;
  std::optional<std::size_t> timed, untimed;  // the first frame with a time, and the first without
  const std::filesystem::path folder = file.parent_path();
  for (std::size_t i = 0; i < frames->size(); ++i) {
    const Place frame{(*frames)[i], file.string() + ": frame " + std::to_string(i)};
    if (!frame.json.is_object()) frame.fail("is not an object");
    const auto listed = frame.text("file_path");
    if (!listed || listed->empty()) frame.fail("has no 'file_path'");
    Photo photo;
    photo.file = image_file(folder, *listed).lexically_normal();
    photo.name = std::filesystem::path(*listed).lexically_normal().generic_string();
    // The name is as in the dataset, plus the extension if it was omitted.
    if (const std::string extension = photo.file.extension().string(); !photo.name.ends_with(extension))
      photo.name += extension;
    photo.listed_in = file;
    if (const auto mask = frame.text("mask_path"); mask && !mask->empty())
      photo.mask_file = (folder / *mask).lexically_normal();
    photo.lens = shared;
    read_lens(frame, photo.lens);
    check_lens(photo.lens, frame.where);
    photo.camera_from_world = read_pose(frame);
    const std::optional<double> time = frame.number("time");
    if (std::optional<std::size_t>& first = time ? timed : untimed; !first) first = i;
    photo.time = time.value_or(0);
    if (!(photo.time >= 0 && photo.time <= 1)) frame.fail("'time' must lie between 0 and 1");
    result.photos.push_back(std::move(photo));
  }
  if (timed && untimed) {
    top.fail("frame " + std::to_string(*untimed) + " has no 'time', but frame " + std::to_string(*timed) +
             " has one; give a time to every frame, or to none");
  }
  result.timed = timed.has_value();
  result.train = read_split(top, "train_filenames", folder, result.photos);
  result.test = read_split(top, "test_filenames", folder, result.photos);
  if (result.test.empty()) result.test = read_split(top, "val_filenames", folder, result.photos);
  if (const auto points = top.text("ply_file_path")) result.points_file = folder / *points;
  return result;
}

}  // namespace splatboost
