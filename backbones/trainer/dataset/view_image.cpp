// SPDX-License-Identifier: Apache-2.0
#include "trainer/dataset/view_image.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <new>
#include <utility>
#include <vector>

#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>

#include "splatboost/errors.h"
#include "trainer/dataset/picture_size.h"
#include "trainer/images/brown_conrady.h"
#include "trainer/images/image_codec.h"
#include "trainer/images/image_damage.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

constexpr int kWidthLimit = 1600;  // as in 3DGS, if no resolution is given
constexpr int kLargestDivisor = 8;
/// Fraction of a photo that undistortion must leave. Lenses leave most of it; wrong parameters can leave nothing.
constexpr double kLeastUndistorted = 0.1;
constexpr int kLeastScaledSide = 8;  // of a reduced copy of a photo
constexpr int kSmallestWidth = 16;   // a smaller "width" is more likely an unsupported divisor
/// Least focal length, in sides of the photo (a field of view of 169°): less is not in pixels.
constexpr double kLeastFocal = 0.05;

[[noreturn]] void fail(const Photo& photo, const std::string& cause) {
  throw InputError(photo.file.string() + ": " + cause);
}

std::vector<std::uint8_t> read_bytes(const Photo& photo) {
  std::error_code error;
  if (!std::filesystem::exists(photo.file, error)) {
    fail(photo,
         "the image does not exist" + (photo.listed_in.empty() ? "" : "; " + photo.listed_in.string() + " lists it"));
  }
  if (!std::filesystem::is_regular_file(photo.file, error)) fail(photo, "is not a file");
  const auto size = std::filesystem::file_size(photo.file, error);
  if (error) fail(photo, "cannot be read: " + error.message());
  std::vector<std::uint8_t> bytes(size);
  std::ifstream in(photo.file, std::ios::binary);
  in.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size));
  if (!in) fail(photo, "cannot be read; check its permissions");
  return bytes;
}

std::size_t count_pixels(const Pixels& pixels) {
  return static_cast<std::size_t>(pixels.width) * static_cast<std::size_t>(pixels.height);
}

bool is_transparent(const Pixels& pixels) {
  if (pixels.channels != 4) return false;
  const std::size_t opaque = pixels.bits == 8 ? 0xff : 0xffff, size = static_cast<std::size_t>(pixels.bits) / 8;
  for (std::size_t p = 0; p < count_pixels(pixels); ++p) {
    std::uint16_t alpha = 0;
    std::memcpy(&alpha, pixels.bytes.data() + (4 * p + 3) * size, size);
    if (alpha != opaque) return true;
  }
  return false;
}

std::string size_text(int width, int height) { return std::to_string(width) + "x" + std::to_string(height); }

/// @param check_size function of width and height that throws InputError unless the image may have them; it is called
/// before decoding if the file has a header
template <class CheckSize>
Pixels decode(const Photo& photo, const CheckSize& check_size) {
  const std::vector<std::uint8_t> bytes = read_bytes(photo);
  require_whole_image(bytes, photo.file.string());
  if (const auto size = size_in_header(bytes)) check_size(size->width, size->height);
  Pixels pixels = decode_image(bytes, photo.file.string());
  check_size(pixels.width, pixels.height);
  // OpenCV returns their colours multiplied by alpha; rounding makes this irreversible.
  const bool tiff = has_magic(bytes, {"II*\0", 4}) || has_magic(bytes, {"MM\0*", 4});
  if (tiff && pixels.bits == 8 && is_transparent(pixels)) {
    fail(photo, "transparent TIFF files with 8 bits are not supported; convert it to PNG");
  }
  return pixels;
}

/// 16 bit to 8, rounded.
void narrow(Pixels& pixels) {
  if (pixels.bits == 8) return;
  std::vector<std::uint8_t> bytes(pixels.bytes.size() / 2);
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    std::uint16_t value = 0;
    std::memcpy(&value, pixels.bytes.data() + 2 * i, sizeof value);
    bytes[i] = static_cast<std::uint8_t>((value + 128) / 257);
  }
  pixels.bytes = std::move(bytes);
  pixels.bits = 8;
}

/// Converts to 8-bit RGB; transparent pixels are composited over the background.
Pixels to_rgb(Pixels pixels, bool white_background) {
  narrow(pixels);
  if (pixels.channels == 3) return pixels;
  Pixels rgb{pixels.width, pixels.height, 3, 8, {}};
  rgb.bytes.resize(3 * count_pixels(pixels));
  const int background = white_background ? 255 : 0;
  for (std::size_t p = 0; p < count_pixels(pixels); ++p) {
    const std::uint8_t* from = pixels.bytes.data() + p * static_cast<std::size_t>(pixels.channels);
    for (std::size_t c = 0; c < 3; ++c) {
      rgb.bytes[3 * p + c] =
          pixels.channels == 1
              ? from[0]
              : static_cast<std::uint8_t>((from[c] * from[3] + background * (255 - from[3]) + 127) / 255);
    }
  }
  return rgb;
}

/// Throws InputError if the photo on disk has another size than its camera. Reduced copies (images_2, images_4, …) have
/// one scale for both axes, up to the rounding of the size. Copies of a few pixels are refused, because rounding would
/// let any shape pass.
void require_size_of_camera(const Photo& photo, int width, int height) {
  const Lens& lens = photo.lens;
  const int wide = lens.width == 0 ? width : lens.width, high = lens.height == 0 ? height : lens.height;
  const double scale_x = static_cast<double>(width) / wide, scale_y = static_cast<double>(height) / high;
  if (std::min(width, height) < kLeastScaledSide && (width != wide || height != high)) {
    fail(photo, "is " + size_text(width, height) + ", a copy of a photo of " + size_text(wide, high) +
                    "; copies must have at least " + std::to_string(kLeastScaledSide) + " pixels in both directions");
  }
  if (std::abs(height - high * scale_x) > 1.0 && std::abs(width - wide * scale_y) > 1.0) {
    fail(photo, "is " + size_text(width, height) + ", but its camera in " + photo.listed_in.string() + " is " +
                    size_text(wide, high) + "; only a uniformly scaled image may differ in size");
  }
}

/// Throws InputError if the lens cannot be in pixels of the size that it is for. Photos may be crops, which have their
/// principal point elsewhere, but not farther away than their own size.
void require_pixels(const Photo& photo, const Lens& lens) {
  const auto check = [&](double focal, double centre, int side) {
    const bool near = centre >= -side && centre <= 2.0 * side;
    if (focal >= kLeastFocal * side && near) return;
    const auto text = [](double value) { return nlohmann::json(value).dump(); };
    fail(photo, "its camera" + (photo.listed_in.empty() ? "" : " in " + photo.listed_in.string()) +
                    " has a focal length of " + text(focal) + " and a principal point at " + text(centre) + " for " +
                    std::to_string(side) + " pixels; both must be in pixels of the photo");
  };
  check(lens.fx, *lens.cx, lens.width);
  check(lens.fy, *lens.cy, lens.height);
}

/// The lens in pixels of the photo on disk, with all defaults filled in.
Lens lens_of_photo(const Photo& photo, int width, int height) {
  Lens lens = photo.lens;
  if (lens.width == 0) lens.width = width;
  if (lens.height == 0) lens.height = height;
  if (lens.fx == 0) {
    if (lens.angle_x > 0) lens.fx = 0.5 * lens.width / std::tan(0.5 * lens.angle_x);
    if (lens.fy == 0 && lens.angle_y > 0) lens.fy = 0.5 * lens.height / std::tan(0.5 * lens.angle_y);
  }
  if (lens.fx == 0) lens.fx = lens.fy;
  if (lens.fy == 0) lens.fy = lens.fx;
  lens.cx = lens.cx.value_or(0.5 * lens.width);
  lens.cy = lens.cy.value_or(0.5 * lens.height);
  require_pixels(photo, lens);
  if (lens.width == width && lens.height == height) return lens;

  const double scale_x = static_cast<double>(width) / lens.width;
  const double scale_y = static_cast<double>(height) / lens.height;
  lens.width = width;
  lens.height = height;
  lens.fx *= scale_x;
  lens.cx = *lens.cx * scale_x;
  lens.fy *= scale_y;
  lens.cy = *lens.cy * scale_y;
  return lens;
}

/// The mask of a photo of width × height. @return [H,W] 255: valid, 0: black
Pixels read_mask(const Photo& photo, int width, int height) {
  Photo mask;
  mask.file = photo.mask_file;
  mask.listed_in = photo.listed_in;
  const Pixels stored = decode(mask, [&](int mask_width, int mask_height) {
    if (mask_width == width && mask_height == height) return;
    fail(mask, "is " + size_text(mask_width, mask_height) + ", but its photo " + photo.file.string() + " is " +
                   size_text(width, height) + "; a mask must have the size of its photo");
  });
  return mask_of_picture(stored);
}

/// Resamples to the pinhole of the same focal lengths and principal point.
/// @param mask its values are those of the nearest pixels; may be empty
/// @return [H,W] 255: valid, 0: no data
Pixels undistort(const Lens& lens, Pixels& rgb, Pixels& mask, const std::string& where) {
  const double far_x = std::max(*lens.cx, lens.width - *lens.cx) / lens.fx;
  const double far_y = std::max(*lens.cy, lens.height - *lens.cy) / lens.fy;
  const BrownConrady model{lens.k1, lens.k2, lens.k3, lens.p1, lens.p2};
  const double fold = model.fold_radius(std::hypot(far_x, far_y));

  std::vector<float> positions;
  positions.reserve(2 * count_pixels(rgb));
  Pixels valid{rgb.width, rgb.height, 1, 8, {}};
  valid.bytes.reserve(count_pixels(rgb));
  const std::vector<std::uint8_t> distorted_mask = mask.bytes;
  const auto nearest = [](double source, int side) {
    return static_cast<std::size_t>(std::clamp(static_cast<int>(std::lround(source)), 0, side - 1));
  };
  for (int row = 0; row < rgb.height; ++row) {
    for (int column = 0; column < rgb.width; ++column) {
      const glm::dvec2 point((column + 0.5 - *lens.cx) / lens.fx, (row + 0.5 - *lens.cy) / lens.fy);
      const glm::dvec2 shown = model.distort(point);
      // resample_image() measures from the centre of the first pixel, cx and cy from the corner of the image.
      const double source_x = lens.fx * shown.x + *lens.cx - 0.5;
      const double source_y = lens.fy * shown.y + *lens.cy - 0.5;
      const bool inside = source_x >= -0.5 && source_y >= -0.5 && source_x <= rgb.width - 0.5 &&
                          source_y <= rgb.height - 0.5 && glm::length(point) <= fold;
      if (inside && !distorted_mask.empty()) {
        mask.bytes[valid.bytes.size()] =
            distorted_mask[nearest(source_y, rgb.height) * static_cast<std::size_t>(rgb.width) +
                           nearest(source_x, rgb.width)];
      }
      valid.bytes.push_back(inside ? 255 : 0);
      positions.push_back(inside ? static_cast<float>(source_x) : -1e4f);
      positions.push_back(inside ? static_cast<float>(source_y) : -1e4f);
    }
  }
  rgb = resample_image(rgb, positions, where);
  for (std::size_t p = 0; p < valid.bytes.size(); ++p) {
    if (valid.bytes[p] == 0) std::fill_n(rgb.bytes.begin() + static_cast<std::ptrdiff_t>(3 * p), 3, std::uint8_t{0});
  }
  return valid;
}

void scale_lens(Lens& lens, ImageSize size) {
  const double scale_x = static_cast<double>(size.width) / lens.width;
  const double scale_y = static_cast<double>(size.height) / lens.height;
  lens.width = size.width;
  lens.height = size.height;
  lens.fx *= scale_x;
  lens.cx = *lens.cx * scale_x;
  lens.fy *= scale_y;
  lens.cy = *lens.cy * scale_y;
}

std::vector<std::uint8_t> to_planar(const Pixels& rgb) {
  const std::size_t pixels = count_pixels(rgb);
  std::vector<std::uint8_t> planar(3 * pixels);
  for (std::size_t p = 0; p < pixels; ++p) {
    for (std::size_t c = 0; c < 3; ++c) planar[c * pixels + p] = rgb.bytes[3 * p + c];
  }
  return planar;
}

template <class T>
void write_png_of(const std::filesystem::path& path, int width, int height, int channels, std::span<const T> values) {
  SPLATBOOST_CHECK(width > 0 && height > 0 && (channels == 1 || channels == 3 || channels == 4),
                   "a PNG needs a positive size and 1, 3 or 4 channels");
  SPLATBOOST_CHECK(values.size() == static_cast<std::size_t>(width) * static_cast<std::size_t>(height) *
                                        static_cast<std::size_t>(channels),
                   "the pixels of a PNG must fill width x height x channels");
  Pixels pixels{width, height, channels, 8 * static_cast<int>(sizeof(T)), {}};
  pixels.bytes.resize(values.size_bytes());
  std::memcpy(pixels.bytes.data(), values.data(), values.size_bytes());
  const std::vector<std::uint8_t> file = encode_png(pixels, path.string());
  write_text_atomically(path, std::string(file.begin(), file.end()));
}

/// The size divided by `scale`, if the photo is that large. Throws InputError, beginning with `where`.
ImageSize rescaled(ImageSize size, double scale, ImageSize photo, const std::string& where) {
  const auto text = [](ImageSize s) { return size_text(s.width, s.height); };
  const ImageSize wanted{std::max(1, static_cast<int>(size.width / scale)),
                         std::max(1, static_cast<int>(size.height / scale))};
  // `size` may have been rounded up.
  require(wanted.width < photo.width + 1 / scale && wanted.height < photo.height + 1 / scale,
          where + ": has " + text(photo) + " pixels, but ncc_scale needs " + text(wanted) +
              "; use a larger --resolution divisor, or a larger ncc_scale");
  return {std::min(wanted.width, photo.width), std::min(wanted.height, photo.height)};
}

}  // namespace

void check_lens(const Lens& lens, const std::string& where) {
  constexpr int kLargestSide = 1 << 20;
  const auto require = [&](bool good, const std::string& cause) {
    if (!good) throw InputError(where + ": " + cause);
  };
  require(lens.width >= 0 && lens.height >= 0 && lens.width <= kLargestSide && lens.height <= kLargestSide,
          "the image size " + std::to_string(lens.width) + "x" + std::to_string(lens.height) + " is not possible");
  const auto positive = [](double value) { return std::isfinite(value) && value > 0; };
  const auto open_or_positive = [&](double value) { return value == 0 || positive(value); };
  require(open_or_positive(lens.fx) && open_or_positive(lens.fy),
          "the focal length must be a finite number above zero");
  const auto angle = [&](double value) { return value == 0 || (positive(value) && value < 3.14); };
  require(angle(lens.angle_x) && angle(lens.angle_y), "the field of view must lie between 0 and pi radians");
  require(lens.fx > 0 || lens.fy > 0 || lens.angle_x > 0 || lens.angle_y > 0,
          "neither a focal length nor a field of view is given");
  require(std::isfinite(lens.cx.value_or(0)) && std::isfinite(lens.cy.value_or(0)),
          "the principal point must be finite");
  require(std::isfinite(lens.k1) && std::isfinite(lens.k2) && std::isfinite(lens.k3) && std::isfinite(lens.p1) &&
              std::isfinite(lens.p2),
          "the distortion must be finite");
}

ImageSize target_size(int width, int height, int resolution) {
  if (resolution == -1) resolution = kWidthLimit;
  if (resolution <= kLargestDivisor) {
    // Halves are rounded to even, as in 3DGS.
    const auto divided = [&](int side) {
      return std::max(1, static_cast<int>(std::lrint(static_cast<double>(side) / resolution)));
    };
    return {divided(width), divided(height)};
  }
  if (resolution >= width) return {width, height};  // enlarging a photo adds work and no information
  const auto scaled = static_cast<int>(static_cast<std::int64_t>(height) * resolution / width);
  return {resolution, std::max(1, scaled)};
}

void check_resolution(int resolution) {
  if (resolution == -1 || resolution == 1 || resolution == 2 || resolution == 4 || resolution == 8) return;
  if (resolution >= kSmallestWidth) return;
  throw InputError("resolution " + std::to_string(resolution) +
                   " is not possible: use -1 (full, at most 1600 px wide), "
                   "the divisors 1, 2, 4, 8, or a width of at least " +
                   std::to_string(kSmallestWidth) + " px");
}

LoadedView load_view(const Photo& photo, const ImageOptions& options) {
  try {
    return load_view(photo, options,
                     decode(photo, [&](int width, int height) { require_size_of_camera(photo, width, height); }));
  } catch (const std::bad_alloc&) {
    fail(photo, "there is not enough memory to read it; use smaller photos, or a larger --resolution divisor");
  }
}

LoadedView load_view(const Photo& photo, const ImageOptions& options, Pixels stored) {
  LoadedView loaded;
  const std::string where = photo.file.string();
  loaded.photo_size = {stored.width, stored.height};
  loaded.transparent = is_transparent(stored);
  Pixels rgb = to_rgb(std::move(stored), options.white_background);
  require_size_of_camera(photo, rgb.width, rgb.height);
  Lens lens = lens_of_photo(photo, rgb.width, rgb.height);

  Pixels valid, mask;
  if (!photo.mask_file.empty()) mask = read_mask(photo, rgb.width, rgb.height);
  loaded.undistorted = lens.distorted();
  if (loaded.undistorted) {
    valid = undistort(lens, rgb, mask, where);
    const auto left = static_cast<std::size_t>(std::ranges::count(valid.bytes, std::uint8_t{255}));
    if (static_cast<double>(left) < kLeastUndistorted * static_cast<double>(valid.bytes.size())) {
      fail(photo, "undistorting it leaves " + std::to_string(left) + " of " + std::to_string(valid.bytes.size()) +
                      " pixels: check the distortion of its camera in " + photo.listed_in.string());
    }
  }

  for (std::size_t p = 0; p < mask.bytes.size() && loaded.undistorted; ++p) {
    mask.bytes[p] = std::min(mask.bytes[p], valid.bytes[p]);
  }
  if (!mask.bytes.empty()) valid = std::move(mask);

  ImageSize size = target_size(rgb.width, rgb.height, options.resolution);
  if (options.photo_scale != 1) size = rescaled(size, options.photo_scale, {rgb.width, rgb.height}, where);
  if (size != loaded.photo_size) {
    loaded.limited = options.resolution == -1;
    rgb = shrink_image(rgb, size.width, size.height, where);
    if (!valid.bytes.empty()) valid = shrink_mask(valid, size.width, size.height, where);
    scale_lens(lens, size);
  }

  View& view = loaded.view;
  view.name = photo.name;
  view.time = static_cast<float>(photo.time);
  view.color = to_planar(rgb);
  // A mask that is valid everywhere is dropped: no mask is cheaper.
  if (std::ranges::any_of(valid.bytes, [](std::uint8_t value) { return value == 0; })) {
    view.valid = std::move(valid.bytes);
    if (!photo.mask_file.empty() && std::ranges::count(view.valid, std::uint8_t{0}) == std::ssize(view.valid)) {
      fail(photo, "its mask " + photo.mask_file.string() + " leaves no pixel of it; remove the image from " +
                      photo.listed_in.string() + ", or correct the mask");
    }
  }
  view.camera.width = lens.width;
  view.camera.height = lens.height;
  view.camera.fx = static_cast<float>(lens.fx);
  view.camera.fy = static_cast<float>(lens.fy);
  view.camera.cx = static_cast<float>(*lens.cx);
  view.camera.cy = static_cast<float>(*lens.cy);
  view.camera.camera_from_world = glm::mat4(photo.camera_from_world);
  try {
    check_camera(view.camera);
  } catch (const ArgumentError& error) {
    // The values are for the line that names them; the expression behind it is for developers.
    const std::string reason = error.what();
    fail(photo,
         "its camera in " + photo.listed_in.string() + " cannot be used: " + reason.substr(0, reason.find(" (")));
  }
  return loaded;
}

RawImage read_raw_image(const std::filesystem::path& file) {
  Photo photo;
  photo.file = file;
  const Pixels pixels = decode(photo, [](int, int) {});
  RawImage raw{pixels.width, pixels.height, pixels.channels, pixels.bits, {}};
  if (pixels.bits == 8) {
    raw.values.assign(pixels.bytes.begin(), pixels.bytes.end());
  } else {
    raw.values.resize(pixels.bytes.size() / 2);
    std::memcpy(raw.values.data(), pixels.bytes.data(), pixels.bytes.size());
  }
  return raw;
}

void write_png(const std::filesystem::path& path, int width, int height, int channels,
               std::span<const std::uint8_t> pixels) {
  write_png_of(path, width, height, channels, pixels);
}

void write_png(const std::filesystem::path& path, int width, int height, int channels,
               std::span<const std::uint16_t> pixels) {
  write_png_of(path, width, height, channels, pixels);
}

}  // namespace splatboost
