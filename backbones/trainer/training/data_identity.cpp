// SPDX-License-Identifier: Apache-2.0
#include "trainer/training/data_identity.h"

#include <cstdint>
#include <cstdio>
#include <span>
#include <utility>

#include <glm/gtc/type_ptr.hpp>

#include "trainer/support/checksum.h"

namespace splatboost {
namespace {

constexpr std::string_view kTestPart = "test";
constexpr std::string_view kPointsPart = "points";

/// The parts, in the order in which differences are reported: a different split implies different photos, too.
constexpr std::pair<const char*, const char*> kParts[] = {
    {"split", "a different choice or different names of training and test views"},
    {"cameras", "different cameras of the training views"},
    {"photos", "different photos: pixels of the training views differ"},
    {kTestPart.data(), "different test views: their cameras or pixels differ"},
    {kPointsPart.data(), "different initial points"}};

template <class T>
std::uint64_t add(std::span<const T> values, std::uint64_t sum) {
  return checksum(std::as_bytes(values), sum);
}

std::uint64_t cameras_of(const std::vector<View>& views) {
  std::uint64_t sum = 0;
  for (const View& view : views) {
    const Camera& camera = view.camera;
    const int size[] = {camera.width, camera.height};
    const float lens[] = {camera.fx, camera.fy, camera.cx, camera.cy, view.time};
    sum = add(std::span<const int>(size), sum);
    sum = add(std::span<const float>(lens), sum);
    sum = add(std::span<const float>(glm::value_ptr(camera.camera_from_world), 16), sum);
  }
  return sum;
}

std::uint64_t photos_of(const std::vector<View>& views, std::uint64_t sum) {
  for (const View& view : views) {
    sum = add(std::span<const std::uint8_t>(view.color), sum);
    sum = add(std::span<const std::uint8_t>(view.valid), sum);
  }
  return sum;
}

std::uint64_t names_of(const std::vector<View>& views, std::uint64_t sum) {
  const std::uint64_t count = views.size();
  sum = add(std::span(&count, 1), sum);
  for (const View& view : views) sum = add(std::span<const char>(view.name), sum);
  return sum;
}

std::string hexadecimal(std::uint64_t sum) {
  char text[17];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(sum));
  return text;
}

}  // namespace

nlohmann::json data_identity(const Scene& scene) {
  nlohmann::json points;  // null where the photos determine them, in a way that depends on the program's version
  if (!scene.lacks_points) {
    const std::uint64_t positions = add(std::span<const float>(scene.points.positions), 0);
    points = hexadecimal(add(std::span<const std::uint8_t>(scene.points.colors), positions));
  }
  return {{"split", hexadecimal(names_of(scene.test, names_of(scene.train, 0)))},
          {"cameras", hexadecimal(cameras_of(scene.train))},
          {"photos", hexadecimal(photos_of(scene.train, 0))},
          {kTestPart, hexadecimal(photos_of(scene.test, cameras_of(scene.test)))},
          {kPointsPart, points}};
}

std::string data_difference(const nlohmann::json& one, const nlohmann::json& other) {
  for (const auto& [part, words] : kParts) {
    const nlohmann::json a = one.contains(part) ? one.at(part) : nullptr,
                         b = other.contains(part) ? other.at(part) : nullptr;
    // Runs of earlier versions have no checksum of the test views, but one of points that they made.
    const bool may_lack = part == kTestPart || part == kPointsPart;
    if (a != b && !(may_lack && (a.is_null() || b.is_null()))) return words;
  }
  return "";
}

}  // namespace splatboost
