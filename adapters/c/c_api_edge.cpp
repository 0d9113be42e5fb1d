// SPDX-License-Identifier: Apache-2.0
#include "c/c_api_edge.h"

#include <cstdio>
#include <limits>
#include <mutex>
#include <string>
#include <vector>

namespace splatboost::edge {
namespace {

/// Fixed size, so that storing a message cannot fail.
thread_local char last_error[1024] = "";

const char* type_name(std::int32_t type) {
  switch (type) {
    case SB_FLOAT32:
      return "float32";
    case SB_FLOAT64:
      return "float64";
    case SB_INT32:
      return "int32";
    case SB_INT64:
      return "int64";
    case SB_UINT8:
      return "uint8";
    default:
      return "unknown type";
  }
}

std::size_t type_size(std::int32_t type) {
  if (type == SB_UINT8) return 1;
  return type == SB_FLOAT64 || type == SB_INT64 ? 8 : 4;
}

std::string device_name(std::int32_t kind, std::int32_t index) {
  return kind == SB_CPU ? "the CPU" : "CUDA device " + std::to_string(index);
}

template <class Sizes>
std::string bracketed(const Sizes& sizes) {
  std::string text = "[";
  for (const std::int64_t size : sizes) {
    if (text.size() > 1) text += ',';
    text += size == kAny ? "any" : std::to_string(size);
  }
  return text + "]";
}

bool fits(std::span<const std::int64_t> shape, Shape wanted) {
  if (shape.size() != wanted.size()) return false;
  const std::int64_t* size = shape.data();
  for (const std::int64_t w : wanted) {
    if (w != kAny && w != *size) return false;
    ++size;
  }
  return true;
}

[[noreturn]] void refuse(const char* name, const std::string& wanted, const std::string& given) {
  throw ArgumentError(std::string(name) + ": expected " + wanted + ", got " + given);
}

}  // namespace

sb_status failed(sb_status status, const char* message) noexcept {
  std::snprintf(last_error, sizeof last_error, "%s", message);
  return status;
}

Place::Place(const sb_device* device) {
  if (device == nullptr) return;
  SPLATBOOST_CHECK(device->kind == SB_CPU || device->kind == SB_CUDA,
                   "device.kind must be SB_CPU or SB_CUDA, not " + std::to_string(device->kind));
  kind_ = device->kind;
  index_ = device->index;
  if (is_cuda()) {
    SPLATBOOST_CHECK(index_ >= 0, "device.index must not be negative");
    if (*cuda_architectures() == '\0') {
      throw NoDeviceError(
          "this libsplatboost was built without CUDA: build it with -DSPLATBOOST_CUDA=ON (pip install . "
          "--config-settings=cmake.define.SPLATBOOST_CUDA=ON), or pass tensors of the CPU");
    }
    stream_.emplace(index_, nullptr);
    return;
  }
  SPLATBOOST_CHECK(index_ == 0, "device.index must be 0 on the CPU");
  SPLATBOOST_CHECK(device->threads >= 0 && device->threads <= kMaxThreads,
                   "device.threads must be 0 to " + std::to_string(kMaxThreads));
  threads_ = Threads(device->threads);
}

Place::Call::Call(Place& place, void* stream) {
  if (place.is_cuda()) {
    cuda_.emplace(*place.stream_, stream);
  } else {
    SPLATBOOST_CHECK(stream == nullptr, "a stream must be NULL on the CPU");
  }
}

namespace {

/// Never destroyed, because CUDA may already be shut down when static objects are destroyed.
struct IdlePlaces {
  std::mutex mutex;
  std::vector<std::unique_ptr<Place>> places;
};
IdlePlaces& idle_places() {
  static auto* const idle = new IdlePlaces;
  return *idle;
}

}  // namespace

BorrowedPlace::BorrowedPlace(const sb_device* device) {
  if (device != nullptr && device->kind == SB_CUDA) {
    IdlePlaces& idle = idle_places();
    const std::lock_guard lock(idle.mutex);
    for (std::unique_ptr<Place>& place : idle.places) {
      if (place->index() != device->index) continue;
      place_ = std::move(place);
      std::swap(place, idle.places.back());
      idle.places.pop_back();
      return;
    }
  }
  place_ = std::make_unique<Place>(device);
}

BorrowedPlace::~BorrowedPlace() {
  if (!place_->is_cuda()) return;
  IdlePlaces& idle = idle_places();
  const std::lock_guard lock(idle.mutex);
  idle.places.push_back(std::move(place_));
}

std::size_t Place::check(const sb_tensor& tensor, const char* name, std::int32_t type,
                         std::initializer_list<Shape> wanted) const {
  if (tensor.device_kind != kind() || tensor.device_index != index()) {
    refuse(name, "memory of " + device_name(kind(), index()),
           "memory of " + device_name(tensor.device_kind, tensor.device_index));
  }
  if (tensor.type != type) refuse(name, type_name(type), type_name(tensor.type));
  if (tensor.dimensions < 0 || tensor.dimensions > SB_MAX_DIMENSIONS) {
    refuse(name, "0 to " + std::to_string(SB_MAX_DIMENSIONS) + " dimensions", std::to_string(tensor.dimensions));
  }
  const std::span<const std::int64_t> shape(tensor.shape, static_cast<std::size_t>(tensor.dimensions));
  bool any = false;
  for (const Shape& w : wanted) any = any || fits(shape, w);
  if (!any) refuse(name, "shape " + bracketed(*wanted.begin()), bracketed(shape));

  // The size in bytes must fit in ptrdiff_t.
  const std::int64_t most = std::numeric_limits<std::ptrdiff_t>::max() / static_cast<std::int64_t>(type_size(type));
  std::int64_t elements = 1;
  for (const std::int64_t size : shape) {
    if (size < 0) throw ArgumentError(std::string(name) + ": negative size in shape " + bracketed(shape));
    if (size > 0 && elements > most / size) {
      throw ArgumentError(std::string(name) + ": shape " + bracketed(shape) + " exceeds the address space");
    }
    elements *= size;
  }
  if (elements == 0) return 0;
  SPLATBOOST_CHECK(tensor.data != nullptr, std::string(name) + ": data must not be NULL");
  if (reinterpret_cast<std::uintptr_t>(tensor.data) % type_size(type) != 0) {
    throw ArgumentError(std::string(name) + ": data is not aligned for " + type_name(type));
  }
  std::int64_t dense = 1;
  for (std::size_t d = shape.size(); d-- > 0;) {
    if (shape[d] != 1 && tensor.strides[d] != dense) {
      throw ArgumentError(std::string(name) + ": not dense and row-major (expected stride " + std::to_string(dense) +
                          ", got " + std::to_string(tensor.strides[d]) + ", in dimension " + std::to_string(d) +
                          "): make it contiguous");
    }
    dense *= shape[d];
  }
  return static_cast<std::size_t>(elements);
}

std::int64_t size_of(const sb_tensor* tensor, const char* name, int dimension) {
  const sb_tensor& t = need(tensor, name);
  if (t.dimensions <= dimension || t.dimensions > SB_MAX_DIMENSIONS) {
    throw ArgumentError(std::string(name) + ": expected " + std::to_string(dimension + 1) + " to " +
                        std::to_string(SB_MAX_DIMENSIONS) + " dimensions, got " + std::to_string(t.dimensions));
  }
  if (t.shape[dimension] < 0) throw ArgumentError(std::string(name) + ": negative size");
  return t.shape[dimension];
}

Camera camera_of(const sb_camera* camera) {
  const sb_camera& c = need(camera, "camera");
  Camera out;
  out.width = c.width;
  out.height = c.height;
  out.fx = c.fx;
  out.fy = c.fy;
  out.cx = c.cx;
  out.cy = c.cy;
  for (int row = 0; row < 4; ++row) {
    for (int column = 0; column < 4; ++column)
      out.camera_from_world[column][row] = c.camera_from_world[4 * row + column];
  }
  check_camera(out);
  return out;
}

RasterOptions options_of(const sb_raster_options* options) {
  const sb_raster_options& o = need(options, "options");
  SPLATBOOST_CHECK(o.box == SB_BOX_SQUARE || o.box == SB_BOX_ELLIPSE,
                   "options.box must be SB_BOX_SQUARE or SB_BOX_ELLIPSE, not " + std::to_string(o.box));
  RasterOptions out;
  out.box = o.box == SB_BOX_SQUARE ? BoxPolicy::square : BoxPolicy::ellipse;
  out.beta = o.beta;
  out.low_pass = o.low_pass;
  out.compensate_opacity = o.compensate_opacity != 0;
  out.near_plane = o.near_plane;
  out.background = {o.background[0], o.background[1], o.background[2]};
  return out;
}

Gaussians Place::gaussians(const sb_gaussians* gaussians, bool drawn) const {
  const sb_gaussians& g = need(gaussians, "gaussians");
  const std::int64_t n = size_of(g.means, "means");
  Gaussians out;
  out.count = static_cast<std::size_t>(n);
  out.means = view<const float>(g.means, "means", {n, 3});
  out.scales = optional_view<const float>(g.scales, "scales", {n, 3});
  out.rotations = optional_view<const float>(g.rotations, "rotations", {n, 4});
  out.covariances = optional_view<const float>(g.covariances, "covariances", {n, 6});
  const bool shapes = g.scales != nullptr && g.rotations != nullptr;
  if (shapes == (g.covariances != nullptr) || (g.scales != nullptr) != (g.rotations != nullptr)) {
    throw ArgumentError("give either scales and rotations, or covariances");
  }
  if (!drawn) return out;

  out.opacities = view<const float>(g.opacities, "opacities", {{n}, {n, 1}});
  colors_of(*this, g, n, out);
  out.features = optional_view<const float>(g.features, "features", {n, kAny});
  if (g.features != nullptr) {
    SPLATBOOST_CHECK(g.features->shape[1] <= kMaxFeatures, "features: at most 8 channels");
    out.features_per_gaussian = static_cast<int>(g.features->shape[1]);
  }
  return out;
}

TruthImage Place::truth(const sb_truth* truth, const sb_tensor* render) const {
  const sb_truth& t = need(truth, "truth");
  const std::int64_t height = size_of(render, "render", 1), width = size_of(render, "render", 2);
  SPLATBOOST_CHECK(width > 0 && height > 0 && width < (1 << 30) && height < (1 << 30),
                   "render: width and height must be above 0 and below 2^30");
  TruthImage out;
  out.width = static_cast<int>(width);
  out.height = static_cast<int>(height);
  out.color = view<const std::uint8_t>(t.color, "truth", {3, height, width});
  out.valid = optional_view<const std::uint8_t>(t.valid, "valid", {height, width});
  return out;
}

}  // namespace splatboost::edge

extern "C" const char* sb_last_error(void) { return splatboost::edge::last_error; }
