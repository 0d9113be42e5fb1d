// SPDX-License-Identifier: Apache-2.0
#include "trainer/formats/colmap.h"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <set>
#include <sstream>
#include <string_view>

#include <glm/gtc/quaternion.hpp>

#include "trainer/dataset/splat_ply.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

static_assert(std::endian::native == std::endian::little, "COLMAP's binary files are little endian");

constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";  // some editors begin UTF-8 files with it

struct CameraModel {
  int number;
  std::string_view name;
  std::size_t parameters;
  bool supported;
};

// https://colmap.github.io/cameras.html
constexpr std::array<CameraModel, 12> kModels{{{0, "SIMPLE_PINHOLE", 3, true},
                                               {1, "PINHOLE", 4, true},
                                               {2, "SIMPLE_RADIAL", 4, true},
                                               {3, "RADIAL", 5, true},
                                               {4, "OPENCV", 8, true},
                                               {5, "OPENCV_FISHEYE", 8, false},
                                               {6, "FULL_OPENCV", 12, false},
                                               {7, "FOV", 5, false},
                                               {8, "SIMPLE_RADIAL_FISHEYE", 4, false},
                                               {9, "RADIAL_FISHEYE", 5, false},
                                               {10, "THIN_PRISM_FISHEYE", 12, false},
                                               {11, "RAD_TAN_THIN_PRISM_FISHEYE", 16, false}}};

[[noreturn]] void fail(const std::filesystem::path& file, const std::string& cause) {
  throw InputError(file.string() + ": " + cause);
}

[[noreturn]] void fail_model(const std::filesystem::path& file, std::uint32_t camera, const std::string& name) {
  std::string supported;
  for (const CameraModel& model : kModels) {
    if (model.supported) supported += (supported.empty() ? "" : ", ") + std::string(model.name);
  }
  fail(file, "camera " + std::to_string(camera) + " has the model " + name + ", which is not supported (supported: " +
                 supported + "); undistort the photos with 'colmap image_undistorter' first");
}

/// Throws InputError if the model is none of COLMAP's; it may be one that is not supported.
template <class Model>
const CameraModel& model_of(const std::filesystem::path& file, std::uint32_t camera, const Model& wanted) {
  for (const CameraModel& model : kModels) {
    bool same = false;
    if constexpr (std::is_same_v<Model, int>) {
      same = model.number == wanted;
    } else {
      same = model.name == wanted;
    }
    if (same) return model;
  }
  if constexpr (std::is_same_v<Model, int>) {
    fail_model(file, camera, "number " + std::to_string(wanted));
  } else {
    fail_model(file, camera, std::string("'").append(wanted).append("'"));
  }
}

/// Reads values from a binary file; throws instead of reading beyond its end.
class BinaryReader {
 public:
  explicit BinaryReader(std::filesystem::path file) : file_(std::move(file)), in_(file_, std::ios::binary) {
    std::error_code error;
    remaining_ = std::filesystem::file_size(file_, error);
    if (error || !in_) fail(file_, "cannot be opened; check its permissions");
  }

  template <class T>
  T read() {
    T value;
    need(sizeof(T));
    in_.read(reinterpret_cast<char*>(&value), sizeof(T));
    if (!in_) fail(file_, "cannot be read");
    remaining_ -= sizeof(T);
    return value;
  }

  /// Reads a number of records of at least `record_bytes` each; throws if they do not fit in the rest of the file.
  std::uint64_t read_count(std::uint64_t record_bytes, const std::string& what) {
    const auto count = read<std::uint64_t>();
    if (count > remaining_ / record_bytes) {
      fail(file_, "is cut short or damaged: it declares " + std::to_string(count) + " " + what + ", but only " +
                      std::to_string(remaining_) + " bytes follow");
    }
    return count;
  }

  std::string read_name() {
    std::string name;
    for (char c = read<char>(); c != '\0'; c = read<char>()) name.push_back(c);
    return name;
  }

  void skip(std::uint64_t bytes) {
    need(bytes);
    in_.ignore(static_cast<std::streamsize>(bytes));
    remaining_ -= bytes;
  }

  /// Throws if bytes remain: a damaged count would silently drop records.
  void require_end() const {
    if (remaining_ > 0) fail(file_, "is damaged: bytes follow its end; copy it again");
  }

 private:
  void need(std::uint64_t bytes) const {
    if (bytes > remaining_) fail(file_, "is cut short; copy it again");
  }

  std::filesystem::path file_;
  std::ifstream in_;
  std::uint64_t remaining_ = 0;
};

/// One line of a text model, word by word.
class TextLine {
 public:
  TextLine(const std::filesystem::path& file, std::size_t number, std::string_view text)
      : file_(file), number_(number), rest_(text) {}

  std::string_view word(const char* what) {
    skip_blanks();
    const std::size_t end = std::min(rest_.find_first_of(" \t"), rest_.size());
    if (end == 0) fail_line(std::string("has no ") + what);
    const std::string_view result = rest_.substr(0, end);
    rest_.remove_prefix(end);
    return result;
  }

  template <class T>
  T number(const char* what) {
    const std::string_view text = word(what);
    T value{};
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size()) {
      fail_line("has the invalid value '" + std::string(text.substr(0, 40)) + "' for " + what);
    }
    return value;
  }

  bool at_end() {
    skip_blanks();
    return rest_.empty();
  }

  /// The rest of the line: names may contain blanks.
  std::string remainder(const char* what) {
    if (at_end()) fail_line(std::string("has no ") + what);
    return std::string(rest_);
  }

  [[noreturn]] void fail_line(const std::string& cause) const {
    fail(file_, "line " + std::to_string(number_) + " " + cause);
  }

 private:
  void skip_blanks() { rest_.remove_prefix(std::min(rest_.find_first_not_of(" \t"), rest_.size())); }

  const std::filesystem::path& file_;
  std::size_t number_;
  std::string_view rest_;
};

class TextReader {
 public:
  explicit TextReader(std::filesystem::path file) : file_(std::move(file)), in_(file_) {
    if (!in_) fail(file_, "cannot be opened; check its permissions");
  }

  bool next_raw(std::string& line) {
    if (!std::getline(in_, line)) return false;
    if (number_++ == 0 && line.starts_with(kByteOrderMark)) line.erase(0, kByteOrderMark.size());
    while (!line.empty() && (line.back() == '\r' || line.back() == ' ' || line.back() == '\t')) line.pop_back();
    return true;
  }

  /// The next line that is neither empty nor a comment.
  bool next(std::string& line) {
    while (next_raw(line)) {
      if (!line.empty() && line.front() != '#') return true;
    }
    return false;
  }

  TextLine parse(const std::string& line) const { return {file_, number_, line}; }

 private:
  std::filesystem::path file_;
  std::ifstream in_;
  std::size_t number_ = 0;
};

std::vector<ColmapCamera> read_cameras_binary(const std::filesystem::path& file) {
  BinaryReader in(file);
  std::vector<ColmapCamera> cameras(in.read_count(4 + 4 + 8 + 8, "cameras"));
  for (ColmapCamera& camera : cameras) {
    camera.id = in.read<std::uint32_t>();
    camera.model = in.read<std::int32_t>();
    camera.width = in.read<std::uint64_t>();
    camera.height = in.read<std::uint64_t>();
    camera.params.resize(model_of(file, camera.id, camera.model).parameters);
    for (double& value : camera.params) value = in.read<double>();
  }
  in.require_end();
  return cameras;
}

std::vector<ColmapCamera> read_cameras_text(const std::filesystem::path& file) {
  TextReader in(file);
  std::vector<ColmapCamera> cameras;
  for (std::string line; in.next(line);) {
    TextLine words = in.parse(line);
    ColmapCamera camera;
    camera.id = words.number<std::uint32_t>("camera id");
    const CameraModel& model = model_of(file, camera.id, words.word("camera model"));
    camera.model = model.number;
    camera.width = words.number<std::uint64_t>("width");
    camera.height = words.number<std::uint64_t>("height");
    for (std::size_t i = 0; i < model.parameters; ++i)
      camera.params.push_back(words.number<double>("camera parameter"));
    if (!words.at_end()) words.fail_line("has too many parameters for the model " + std::string(model.name));
    cameras.push_back(std::move(camera));
  }
  return cameras;
}

std::vector<ColmapImage> read_images_binary(const std::filesystem::path& file) {
  BinaryReader in(file);
  std::vector<ColmapImage> images(in.read_count(4 + 4 * 8 + 3 * 8 + 4 + 1 + 8, "images"));
  for (ColmapImage& image : images) {
    image.id = in.read<std::uint32_t>();
    for (double& value : image.rotation) value = in.read<double>();
    for (double& value : image.translation) value = in.read<double>();
    image.camera_id = in.read<std::uint32_t>();
    image.name = in.read_name();
    constexpr std::uint64_t kObservationBytes = 8 + 8 + 8;
    in.skip(kObservationBytes * in.read_count(kObservationBytes, "2D points of image '" + image.name + "'"));
  }
  in.require_end();
  return images;
}

/// Whether the line can be POINTS2D[] as (X, Y, POINT3D_ID): three numbers per point.
bool is_points_line(std::string_view line) {
  std::size_t words = 0;
  while (true) {
    line.remove_prefix(std::min(line.find_first_not_of(" \t"), line.size()));
    if (line.empty()) return words % 3 == 0;
    double value = 0;
    const auto parsed = std::from_chars(line.data(), line.data() + line.size(), value);
    const auto length = static_cast<std::size_t>(parsed.ptr - line.data());
    const bool whole = length == line.size() || line[length] == ' ' || line[length] == '\t';
    if (parsed.ec != std::errc{} || !whole) return false;
    line.remove_prefix(length);
    ++words;
  }
}

std::vector<ColmapImage> read_images_text(const std::filesystem::path& file) {
  TextReader in(file);
  std::vector<ColmapImage> images;
  for (std::string line; in.next(line);) {
    TextLine words = in.parse(line);
    ColmapImage image;
    image.id = words.number<std::uint32_t>("image id");
    for (double& value : image.rotation) value = words.number<double>("rotation");
    for (double& value : image.translation) value = words.number<double>("translation");
    image.camera_id = words.number<std::uint32_t>("camera id");
    image.name = words.remainder("image name");
    images.push_back(std::move(image));
    // The line of its 2D points, often empty. If it is missing, this reads the next image instead.
    if (in.next_raw(line) && !is_points_line(line)) {
      in.parse(line).fail_line("is not the list of 2D points of image '" + images.back().name +
                               "': every image takes two lines, of which the second may be empty");
    }
  }
  return images;
}

void append_point(const std::filesystem::path& file, PointCloud& points, const std::array<double, 3>& position,
                  const std::array<std::uint8_t, 3>& color) {
  for (const double value : position) {
    if (!std::isfinite(static_cast<float>(value))) {
      fail(file, "the position of point " + std::to_string(points.size()) + " is not a finite number");
    }
  }
  for (const double value : position) points.positions.push_back(static_cast<float>(value));
  points.colors.insert(points.colors.end(), color.begin(), color.end());
}

PointCloud read_points_binary(const std::filesystem::path& file) {
  BinaryReader in(file);
  PointCloud points;
  const std::uint64_t count = in.read_count(8 + 3 * 8 + 3 + 8 + 8, "points");
  points.positions.reserve(3 * count);
  points.colors.reserve(3 * count);
  for (std::uint64_t i = 0; i < count; ++i) {
    in.skip(8);  // id
    std::array<double, 3> position{};
    for (double& value : position) value = in.read<double>();
    std::array<std::uint8_t, 3> color{};
    for (std::uint8_t& value : color) value = in.read<std::uint8_t>();
    in.skip(8);  // reprojection error
    constexpr std::uint64_t kTrackBytes = 4 + 4;
    in.skip(kTrackBytes * in.read_count(kTrackBytes, "observations of point " + std::to_string(i)));
    append_point(file, points, position, color);
  }
  in.require_end();
  return points;
}

PointCloud read_points_text(const std::filesystem::path& file) {
  TextReader in(file);
  PointCloud points;
  for (std::string line; in.next(line);) {
    TextLine words = in.parse(line);
    words.number<std::uint64_t>("point id");
    std::array<double, 3> position{};
    for (double& value : position) value = words.number<double>("position");
    std::array<std::uint8_t, 3> color{};
    for (std::uint8_t& value : color) value = words.number<std::uint8_t>("colour");
    append_point(file, points, position, color);
  }
  return points;
}

std::optional<std::filesystem::path> model_file(const std::filesystem::path& folder, const std::string& stem) {
  for (const char* extension : {".bin", ".txt"}) {
    std::filesystem::path file = folder / (stem + extension);
    if (is_file(file)) return file;
  }
  return std::nullopt;
}

Lens lens_of(const ColmapCamera& camera, const std::filesystem::path& file) {
  const CameraModel& model = model_of(file, camera.id, camera.model);
  if (!model.supported) fail_model(file, camera.id, std::string(model.name));
  const std::string where = file.string() + ": camera " + std::to_string(camera.id);
  // Sizes beyond the range of int are clamped; check_lens() rejects them.
  const auto side = [](std::uint64_t value) {
    return static_cast<int>(std::min<std::uint64_t>(value, std::numeric_limits<int>::max()));
  };
  Lens lens;
  lens.width = side(camera.width);
  lens.height = side(camera.height);
  if (lens.width == 0 || lens.height == 0) throw InputError(where + ": the image size is zero");
  const std::vector<double>& p = camera.params;
  const bool one_focal_length = camera.model == 0 || camera.model == 2 || camera.model == 3;
  lens.fx = p.at(0);
  lens.fy = one_focal_length ? p.at(0) : p.at(1);
  lens.cx = one_focal_length ? p.at(1) : p.at(2);
  lens.cy = one_focal_length ? p.at(2) : p.at(3);
  switch (camera.model) {
    case 2:
      lens.k1 = p.at(3);
      break;
    case 3:
      lens.k1 = p.at(3);
      lens.k2 = p.at(4);
      break;
    case 4:
      lens.k1 = p.at(4);
      lens.k2 = p.at(5);
      lens.p1 = p.at(6);
      lens.p2 = p.at(7);
      break;
    default:
      break;
  }
  check_lens(lens, where);
  // In a Lens, zero means "not known"; here it is an error.
  if (lens.fx == 0 || lens.fy == 0) throw InputError(where + ": the focal length must be a finite number above zero");
  return lens;
}

glm::dmat4 pose_of(const ColmapImage& image, const std::string& where) {
  for (const double value : image.rotation) {
    if (!std::isfinite(value))
      throw InputError(where + ": the rotation is not finite; remove the image from the model");
  }
  for (const double value : image.translation) {
    if (!std::isfinite(value))
      throw InputError(where + ": the translation is not finite; remove the image from the model");
  }
  const glm::dquat rotation(image.rotation[0], image.rotation[1], image.rotation[2], image.rotation[3]);
  const double norm = glm::length(rotation);
  if (!(norm > 1e-6 && norm < 1e6)) {
    throw InputError(where + ": the rotation quaternion is " + (norm < 1 ? "zero" : "far longer than 1") +
                     "; remove the image from the model");
  }
  glm::dmat4 pose = glm::mat4_cast(rotation / norm);
  pose[3] = {image.translation[0], image.translation[1], image.translation[2], 1.0};
  return pose;
}

template <class T>
void put(std::ostream& out, const T& value) {
  out.write(reinterpret_cast<const char*>(&value), sizeof(T));
}

}  // namespace

std::optional<std::filesystem::path> find_colmap_model(const std::filesystem::path& source) {
  for (const std::filesystem::path& folder : {source / "sparse" / "0", source / "sparse"}) {
    if (model_file(folder, "cameras") || model_file(folder, "images")) return folder;
  }
  return std::nullopt;
}

std::optional<std::filesystem::path> find_larger_model(const std::filesystem::path& folder, std::size_t images) {
  std::optional<std::filesystem::path> larger;
  std::error_code error;
  for (std::filesystem::directory_iterator entry(folder.parent_path(), error), end; !error && entry != end;
       entry.increment(error)) {
    try {
      const auto file = model_file(entry->path(), "images");
      if (!file || std::filesystem::equivalent(entry->path(), folder)) continue;
      const std::size_t count =
          (file->extension() == ".bin" ? read_images_binary(*file) : read_images_text(*file)).size();
      if (count <= images) continue;
      images = count;
      larger = entry->path();
    } catch (const InputError&) {
      // A damaged model that is not used.
    }
  }
  return larger;
}

ColmapModel read_colmap_model(const std::filesystem::path& folder) {
  ColmapModel model;
  const auto cameras = model_file(folder, "cameras");
  const auto images = model_file(folder, "images");
  if (!cameras) fail(folder, "the COLMAP model has neither cameras.bin nor cameras.txt");
  if (!images) fail(folder, "the COLMAP model has neither images.bin nor images.txt");
  model.cameras_file = *cameras;
  model.images_file = *images;
  model.cameras = cameras->extension() == ".bin" ? read_cameras_binary(*cameras) : read_cameras_text(*cameras);
  model.images = images->extension() == ".bin" ? read_images_binary(*images) : read_images_text(*images);
  if (const auto points = model_file(folder, "points3D")) {
    model.points = points->extension() == ".bin" ? read_points_binary(*points) : read_points_text(*points);
    model.points_file = *points;
  } else if (is_file(folder / "points3D.ply")) {
    model.points_file = folder / "points3D.ply";
    model.points = read_point_ply(model.points_file);
  }
  return model;
}

void write_colmap_model(const std::filesystem::path& folder, const ColmapModel& model, ColmapFormat format) {
  const std::vector<float>& positions = model.points.positions;
  const std::vector<std::uint8_t>& colors = model.points.colors;
  if (format == ColmapFormat::binary) {
    write_file_atomically(folder / "cameras.bin", [&](std::ostream& out) {
      put(out, std::uint64_t{model.cameras.size()});
      for (const ColmapCamera& camera : model.cameras) {
        put(out, camera.id);
        put(out, std::int32_t{camera.model});
        put(out, camera.width);
        put(out, camera.height);
        for (const double value : camera.params) put(out, value);
      }
    });
    write_file_atomically(folder / "images.bin", [&](std::ostream& out) {
      put(out, std::uint64_t{model.images.size()});
      for (const ColmapImage& image : model.images) {
        put(out, image.id);
        for (const double value : image.rotation) put(out, value);
        for (const double value : image.translation) put(out, value);
        put(out, image.camera_id);
        out << image.name << '\0';
        put(out, std::uint64_t{0});
      }
    });
    write_file_atomically(folder / "points3D.bin", [&](std::ostream& out) {
      put(out, std::uint64_t{model.points.size()});
      for (std::size_t i = 0; i < model.points.size(); ++i) {
        put(out, std::uint64_t{i + 1});
        for (std::size_t k = 0; k < 3; ++k) put(out, static_cast<double>(positions[3 * i + k]));
        for (std::size_t k = 0; k < 3; ++k) put(out, colors[3 * i + k]);
        put(out, 0.0);
        put(out, std::uint64_t{0});
      }
    });
    return;
  }
  const auto precise = [](std::ostream& out) -> std::ostream& {
    out.precision(std::numeric_limits<double>::max_digits10);
    return out;
  };
  write_file_atomically(folder / "cameras.txt", [&](std::ostream& out) {
    precise(out) << "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n";
    for (const ColmapCamera& camera : model.cameras) {
      const auto known = std::ranges::find(kModels, camera.model, &CameraModel::number);
      out << camera.id << ' ' << (known == kModels.end() ? "UNKNOWN" : known->name) << ' ' << camera.width << ' '
          << camera.height;
      for (const double value : camera.params) out << ' ' << value;
      out << '\n';
    }
  });
  write_file_atomically(folder / "images.txt", [&](std::ostream& out) {
    precise(out) << "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n";
    for (const ColmapImage& image : model.images) {
      out << image.id;
      for (const double value : image.rotation) out << ' ' << value;
      for (const double value : image.translation) out << ' ' << value;
      out << ' ' << image.camera_id << ' ' << image.name << "\n\n";
    }
  });
  write_file_atomically(folder / "points3D.txt", [&](std::ostream& out) {
    precise(out) << "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n";
    for (std::size_t i = 0; i < model.points.size(); ++i) {
      out << i + 1;
      for (std::size_t k = 0; k < 3; ++k) out << ' ' << positions[3 * i + k];
      for (std::size_t k = 0; k < 3; ++k) out << ' ' << static_cast<int>(colors[3 * i + k]);
      out << " 0\n";
    }
  });
}

std::vector<Photo> colmap_photos(const ColmapModel& model, const std::filesystem::path& image_folder) {
  // Only these cameras are checked: one without images may be of any model, or not calibrated.
  std::set<std::uint32_t> used;
  for (const ColmapImage& image : model.images) used.insert(image.camera_id);
  std::map<std::uint32_t, Lens> lenses;
  for (const ColmapCamera& camera : model.cameras) {
    if (!used.contains(camera.id)) continue;
    if (!lenses.try_emplace(camera.id, lens_of(camera, model.cameras_file)).second) {
      fail(model.cameras_file, "lists camera " + std::to_string(camera.id) + " twice; remove one of the two entries");
    }
  }
  std::vector<Photo> photos;
  photos.reserve(model.images.size());
  for (const ColmapImage& image : model.images) {
    const std::string where = model.images_file.string() + ": image '" + image.name + "'";
    if (image.name.empty()) throw InputError(where + " has no name");
    const auto lens = lenses.find(image.camera_id);
    if (lens == lenses.end()) {
      throw InputError(where + " refers to camera " + std::to_string(image.camera_id) + ", which " +
                       model.cameras_file.string() + " does not have");
    }
    Photo photo;
    photo.name = image.name;
    photo.file = image_folder / image.name;
    photo.listed_in = model.images_file;
    photo.lens = lens->second;
    photo.camera_from_world = pose_of(image, where);
    photos.push_back(std::move(photo));
  }
  std::ranges::stable_sort(photos, {}, &Photo::name);
  return photos;
}

}  // namespace splatboost
