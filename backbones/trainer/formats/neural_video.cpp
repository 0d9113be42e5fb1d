// SPDX-License-Identifier: Apache-2.0
#include "trainer/formats/neural_video.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>

#include "splatboost/threads.h"
#include "trainer/formats/npy.h"
#include "trainer/images/video.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"
#include "trainer/support/text.h"

namespace splatboost {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kRow = 17;  // per camera in poses_bounds.npy: [3,5] of axes, centre and size, two depths

/// In lower case: some cameras write names in capitals.
std::string extension_of(const fs::path& file) {
  std::string extension = file.extension().string();
  for (char& c : extension) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return extension;
}

bool is_video(const fs::path& camera) { return extension_of(camera) == ".mp4"; }

bool is_picture(const fs::path& file) {
  const std::string extension = extension_of(file);
  return extension == ".png" || extension == ".jpg" || extension == ".jpeg";
}

/// Images in the folder, or in its subfolder images/ if there is one, sorted by name and number.
std::vector<fs::path> pictures_of(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code error;
  const fs::path images = fs::is_directory(folder / "images", error) ? folder / "images" : folder;
  for (const auto& entry : fs::directory_iterator(images, error)) {
    if (is_picture(entry.path()) && is_file(entry.path())) files.push_back(entry.path());
  }
  std::ranges::sort(files, in_number_order, &fs::path::native);
  return files;
}

/// The source of each camera, sorted by name as text (cam10 before cam2), which is the order of the rows in
/// poses_bounds.npy: a video, or a folder of its frames, which is preferred to a video of the
/// same name.
std::vector<fs::path> cameras_of(const fs::path& folder) {
  std::vector<fs::path> cameras;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const fs::path& path = entry.path();
    if (!path.filename().string().starts_with("cam")) continue;
    const bool video = is_video(path) && is_file(path);
    std::error_code ignored;
    if (video && pictures_of(folder / path.stem()).empty()) cameras.push_back(path);
    if (fs::is_directory(path, ignored) && !pictures_of(path).empty()) cameras.push_back(path);
  }
  std::ranges::sort(cameras);
  return cameras;
}

/// Reads the camera of a row. Columns of its [3,5] matrix: the axes down, right and back; the centre; height, width and
/// focal length.
void read_pose(const double* row, const std::string& where, Photo& photo) {
  const auto column = [&](int c) { return glm::dvec3(row[c], row[5 + c], row[10 + c]); };
  for (std::size_t i = 0; i < kRow; ++i) require(std::isfinite(row[i]), where + ": has a value that is not finite");
  const glm::dmat3 world_from_camera(column(1), column(0), -column(2));
  const glm::dmat3 product = glm::transpose(world_from_camera) * world_from_camera;
  for (int c = 0; c < 3; ++c) {
    for (int r = 0; r < 3; ++r) {
      require(std::abs(product[c][r] - (r == c ? 1.0 : 0.0)) < 1e-2 && glm::determinant(world_from_camera) > 0,
              where + ": the axes of the camera are not a rotation");
    }
  }
  const glm::dmat3 rotation = glm::transpose(world_from_camera);
  photo.camera_from_world = glm::dmat4(rotation);
  photo.camera_from_world[3] = glm::dvec4(-(rotation * column(3)), 1.0);
  const glm::dvec3 size = column(4);
  require(size[0] >= 1 && size[1] >= 1 && size[0] <= 1 << 20 && size[1] <= 1 << 20,
          where + ": the image size is out of range");
  photo.lens.height = static_cast<int>(std::lround(size[0]));
  photo.lens.width = static_cast<int>(std::lround(size[1]));
  photo.lens.fx = photo.lens.fy = size[2];
  check_lens(photo.lens, where);
}

/// Length of each camera's video, counted up to `frames` (0: all); zero for folders.
std::vector<VideoLength> measure_videos(const std::vector<fs::path>& cameras, int frames) {
  std::vector<VideoLength> lengths(cameras.size());
  Threads().for_range(cameras.size(), 1, [&](std::size_t c, std::size_t) {
    if (is_video(cameras[c])) lengths[c] = measure_video(cameras[c], static_cast<std::size_t>(frames));
  });
  return lengths;
}

/// One line if a video has fewer readable frames than it claims, among those requested; else empty.
std::string note_on_lengths(const std::vector<fs::path>& cameras, const std::vector<VideoLength>& lengths, int frames) {
  std::size_t count = 0, first = 0;
  for (std::size_t c = cameras.size(); c-- > 0;) {
    const std::size_t claimed = lengths[c].claimed;
    const std::size_t wanted = frames == 0 ? claimed : std::min(claimed, static_cast<std::size_t>(frames));
    if (lengths[c].readable >= wanted) continue;
    ++count;
    first = c;
  }
  if (count == 0) return {};
  const std::string others =
      count == 1 ? "" : " (and " + std::to_string(count - 1) + " more videos are also shorter than declared)";
  return cameras[first].filename().string() + " declares " + std::to_string(lengths[first].claimed) +
         " frames, but only " + std::to_string(lengths[first].readable) + " can be read" + others +
         "; training uses the readable frames";
}

}  // namespace

bool is_neural_video(const fs::path& folder) {
  return is_file(folder / "poses_bounds.npy") && cameras_of(folder).size() >= 2;
}

NeuralVideo read_neural_video(const fs::path& folder, int frames) {
  const fs::path poses_file = folder / "poses_bounds.npy";
  const NpyArray poses = read_npy(poses_file);
  require(poses.shape.size() == 2 && poses.shape[1] == kRow, poses_file.string() + ": is not a list of cameras [N,17]");
  const std::vector<fs::path> cameras = cameras_of(folder);
  require(cameras.size() == poses.shape[0], poses_file.string() + ": holds " + std::to_string(poses.shape[0]) +
                                                " cameras, but there are " + std::to_string(cameras.size()) +
                                                " videos or folders cam* beside it");

  const std::vector<VideoLength> lengths = measure_videos(cameras, frames);
  NeuralVideo rig;
  std::vector<std::vector<Photo>> of_cameras;
  std::size_t most = 0;
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    const bool video = is_video(cameras[c]);
    const std::vector<fs::path> files = video ? std::vector<fs::path>{} : pictures_of(cameras[c]);
    const std::size_t readable = video ? lengths[c].readable : files.size();
    const std::size_t count = frames == 0 ? readable : std::min(readable, static_cast<std::size_t>(frames));
    // Frames beyond those requested are not decoded: only the claimed number is known.
    const bool all_known = !video || frames == 0 || count < static_cast<std::size_t>(frames);
    const std::size_t there = all_known ? readable : std::max(readable, lengths[c].claimed);
    require(count > 0, cameras[c].string() + ": holds no frames");
    most = std::max(most, there);
    Photo photo;
    photo.listed_in = poses_file;
    read_pose(poses.values.data() + kRow * c, poses_file.string() + ": camera " + std::to_string(c), photo);
    std::vector<Photo>& photos = of_cameras.emplace_back();
    for (std::size_t f = 0; f < count; ++f) {
      std::string number = std::to_string(f);
      number.insert(0, 4 - std::min<std::size_t>(number.size(), 4), '0');
      photo.name = cameras[c].stem().string() + "/" + (video ? number + ".png" : files[f].filename().string());
      photo.file = video ? cameras[c] : files[f];
      photo.video_frame = video ? static_cast<int>(f) : -1;
      photo.time = static_cast<double>(f);
      photos.push_back(photo);
    }
  }
  std::size_t longest = 0;
  for (const auto& photos : of_cameras) longest = std::max(longest, photos.size());
  for (auto& photos : of_cameras) {
    for (Photo& photo : photos) photo.time = longest > 1 ? photo.time / static_cast<double>(longest - 1) : 0;
  }
  if (longest < most) {
    rig.notes.push_back("using the first " + std::to_string(longest) + " of " + std::to_string(most) +
                        " frames of each camera; use --frames for more");
  }
  if (std::string note = note_on_lengths(cameras, lengths, frames); !note.empty()) rig.notes.push_back(std::move(note));
  rig.test = of_cameras.front().size();
  for (std::size_t c = 1; c < of_cameras.size(); ++c) std::ranges::move(of_cameras[c], std::back_inserter(rig.photos));
  std::ranges::move(of_cameras.front(), std::back_inserter(rig.photos));
  return rig;
}

}  // namespace splatboost
