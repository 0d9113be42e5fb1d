// SPDX-License-Identifier: Apache-2.0
#include "trainer/formats/neural_video.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <utility>

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/matrix.hpp>

#include "splatboost/threads.h"
#include "trainer/formats/frame_times.h"
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
  if (file.filename().string().starts_with(".")) return false;  // "._NAME" of archives made on macOS
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

/// A camera of the rig.
struct RigCamera {
  fs::path source;
  std::vector<fs::path> files;        ///< its pictures; none if the source is a video
  std::vector<std::int64_t> numbers;  ///< of its frames, counted from the first of the rig
};

/// Whether each picture has a number of its own in its name.
bool have_frame_numbers(const std::vector<fs::path>& files) {
  std::set<std::int64_t> numbers;
  for (const fs::path& file : files) {
    const std::int64_t number = frame_number(file.filename().string());
    if (number < 0 || !numbers.insert(number).second) return false;
  }
  return true;
}

/// Numbers the frames of folders by the names of their pictures, so that a missing picture does not shift the times of
/// those after it. If names have no such numbers, pictures are numbered in order, and each camera must have as many.
void number_pictures(std::vector<RigCamera>& cameras) {
  std::vector<RigCamera*> folders;
  for (RigCamera& camera : cameras) {
    if (!camera.files.empty()) folders.push_back(&camera);
  }
  const bool named = std::ranges::all_of(folders, [](const auto* folder) { return have_frame_numbers(folder->files); });
  std::int64_t first = std::numeric_limits<std::int64_t>::max();
  for (RigCamera* folder : folders) {
    const std::vector<fs::path>& reference = folders.front()->files;
    require(named || folder->files.size() == reference.size(),
            folder->source.string() + ": holds " + counted(folder->files.size(), "picture") + ", but " +
                folders.front()->source.filename().string() + " holds " + std::to_string(reference.size()) +
                "; add the missing ones, or give each picture the number of its frame as its name");
    for (std::size_t i = 0; i < folder->files.size(); ++i) {
      const std::string name = folder->files[i].filename().string();
      folder->numbers.push_back(named ? frame_number(name) : static_cast<std::int64_t>(i));
      first = std::min(first, folder->numbers.back());
    }
  }
  for (RigCamera* folder : folders) {
    for (std::int64_t& number : folder->numbers) number -= first;
  }
}

/// @param lengths those of measure_videos()
std::vector<RigCamera> number_frames(const std::vector<fs::path>& sources, const std::vector<VideoLength>& lengths) {
  std::vector<RigCamera> cameras;
  for (std::size_t c = 0; c < sources.size(); ++c) {
    RigCamera& camera = cameras.emplace_back();
    camera.source = sources[c];
    if (!is_video(camera.source)) camera.files = pictures_of(camera.source);
    camera.numbers.resize(lengths[c].readable);
    std::iota(camera.numbers.begin(), camera.numbers.end(), 0);
  }
  number_pictures(cameras);
  for (const RigCamera& camera : cameras) {
    require(!camera.numbers.empty(), camera.source.string() + ": holds no frames");
  }
  return cameras;
}

/// One line if a folder lacks pictures of frames that another one has, among those up to `last`; else empty.
std::string note_on_missing_pictures(const std::vector<RigCamera>& cameras, std::int64_t last) {
  std::map<std::int64_t, fs::path> examples;
  for (const RigCamera& camera : cameras) {
    for (std::size_t i = 0; i < camera.files.size(); ++i) {
      if (camera.numbers[i] <= last) examples.try_emplace(camera.numbers[i], camera.files[i]);
    }
  }
  std::size_t count = 0;
  std::string first;
  for (const RigCamera& camera : cameras) {
    if (camera.files.empty()) continue;
    const std::set<std::int64_t> own(camera.numbers.begin(), camera.numbers.end());
    for (const auto& [number, example] : examples) {
      if (own.contains(number)) continue;
      if (++count > 1) continue;
      first = camera.source.string() + ": has no picture of the frame that " +
              example.lexically_relative(camera.source.parent_path()).string() + " shows";
    }
  }
  if (count == 0) return {};
  const std::string others = count == 1   ? ""
                             : count == 2 ? " (and 1 more picture is missing)"
                                          : " (and " + std::to_string(count - 1) + " more pictures are missing)";
  return first + others + "; training uses the pictures that exist";
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
  const std::vector<RigCamera> rig_cameras = number_frames(cameras, lengths);
  std::set<std::int64_t> numbers;
  for (const RigCamera& camera : rig_cameras) numbers.insert(camera.numbers.begin(), camera.numbers.end());
  std::size_t most = numbers.size();
  for (const VideoLength& length : lengths) {
    // Frames beyond those requested are not decoded: only the claimed number is known.
    if (frames > 0 && length.readable >= static_cast<std::size_t>(frames)) most = std::max(most, length.claimed);
  }
  const std::size_t used = frames == 0 ? numbers.size() : std::min(numbers.size(), static_cast<std::size_t>(frames));
  const std::int64_t last = *std::next(numbers.begin(), static_cast<std::ptrdiff_t>(used - 1));

  NeuralVideo rig;
  std::vector<std::vector<Photo>> of_cameras;
  for (std::size_t c = 0; c < cameras.size(); ++c) {
    const bool video = is_video(cameras[c]);
    const RigCamera& camera = rig_cameras[c];
    Photo photo;
    photo.listed_in = poses_file;
    read_pose(poses.values.data() + kRow * c, poses_file.string() + ": camera " + std::to_string(c), photo);
    std::vector<Photo>& photos = of_cameras.emplace_back();
    for (std::size_t f = 0; f < camera.numbers.size(); ++f) {
      if (camera.numbers[f] > last) continue;
      std::string number = std::to_string(f);
      number.insert(0, 4 - std::min<std::size_t>(number.size(), 4), '0');
      photo.name = cameras[c].stem().string() + "/" + (video ? number + ".png" : camera.files[f].filename().string());
      photo.file = video ? cameras[c] : camera.files[f];
      photo.video_frame = video ? static_cast<int>(f) : -1;
      photo.time = last > 0 ? static_cast<double>(camera.numbers[f]) / static_cast<double>(last) : 0;
      photos.push_back(photo);
    }
    require(!photos.empty(), cameras[c].string() + ": holds none of the first " + counted(used, "frame") +
                                 " of the other cameras; use --frames for more");
  }
  if (used < most) {
    rig.notes.push_back("using the first " + std::to_string(used) + " of " + std::to_string(most) +
                        " frames of each camera; use --frames for more");
  }
  if (std::string note = note_on_missing_pictures(rig_cameras, last); !note.empty()) {
    rig.notes.push_back(std::move(note));
  }
  if (std::string note = note_on_lengths(cameras, lengths, frames); !note.empty()) rig.notes.push_back(std::move(note));
  rig.test = of_cameras.front().size();
  for (std::size_t c = 1; c < of_cameras.size(); ++c) std::ranges::move(of_cameras[c], std::back_inserter(rig.photos));
  std::ranges::move(of_cameras.front(), std::back_inserter(rig.photos));
  return rig;
}

}  // namespace splatboost
