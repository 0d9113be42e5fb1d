// SPDX-License-Identifier: Apache-2.0
/// @file The edge between C and C++: exceptions become codes, tensors become spans, devices become threads or streams.
#pragma once

#include <algorithm>
#include <cstdint>
#include <initializer_list>
#include <memory>
#include <new>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

#include "splatboost/c_api.h"
#include "splatboost/camera.h"
#include "splatboost/cuda_stream.h"
#include "splatboost/device.h"
#include "splatboost/errors.h"
#include "splatboost/gaussians.h"
#include "splatboost/photometric.h"
#include "splatboost/rasterizer.h"
#include "splatboost/ssim.h"
#include "splatboost/threads.h"

namespace splatboost::edge {

/// A callback of the caller reported failure.
class CallbackFailed : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Stores the message for sb_last_error. @return status
sb_status failed(sb_status status, const char* message) noexcept;

/// Runs an entry's body and converts exceptions to a status.
template <class Body>
sb_status guarded(Body&& body) noexcept {
  try {
    body();
    return SB_OK;
  } catch (const ArgumentError& e) {
    return failed(SB_ERROR_ARGUMENT, e.what());
  } catch (const NoDeviceError& e) {
    return failed(SB_ERROR_NO_CUDA, e.what());
  } catch (const DeviceMemoryError& e) {
    return failed(SB_ERROR_MEMORY, e.what());
  } catch (const CallbackFailed& e) {
    return failed(SB_ERROR_CALLBACK, e.what());
  } catch (const std::bad_alloc&) {
    return failed(SB_ERROR_MEMORY, "out of memory");
  } catch (const std::length_error&) {
    return failed(SB_ERROR_MEMORY, "the requested size exceeds the address space");
  } catch (const std::exception& e) {
    return failed(SB_ERROR_INTERNAL, e.what());
  } catch (...) {
    return failed(SB_ERROR_INTERNAL, "unknown error");
  }
}

template <class T>
T& need(T* pointer, const char* name) {
  if (pointer == nullptr) throw ArgumentError(std::string(name) + " must not be NULL");
  return *pointer;
}

/// Matches any size in a wanted shape.
inline constexpr std::int64_t kAny = -1;
using Shape = std::initializer_list<std::int64_t>;

template <class T>
inline constexpr std::int32_t kTypeOf = -1;
template <>
inline constexpr std::int32_t kTypeOf<float> = SB_FLOAT32;
template <>
inline constexpr std::int32_t kTypeOf<double> = SB_FLOAT64;
template <>
inline constexpr std::int32_t kTypeOf<std::int32_t> = SB_INT32;
template <>
inline constexpr std::int32_t kTypeOf<std::int64_t> = SB_INT64;
template <>
inline constexpr std::int32_t kTypeOf<std::uint8_t> = SB_UINT8;

/// The device that calls run on; checks that their tensors are in its memory. Does not use a GPU before the first Call.
class Place {
 public:
  explicit Place(const sb_device* device);

  /// The device to pass to operations; valid as long as this place.
  Device device() { return stream_ ? Device(*stream_) : Device(threads_); }
  bool is_cuda() const { return kind_ == SB_CUDA; }
  /// For what runs on the host; as many as there are CPUs if the device is a GPU.
  const Threads& host_threads() { return threads_; }
  /// device_kind and device_index of tensors on this place.
  std::int32_t kind() const { return kind_; }
  std::int32_t index() const { return index_; }

  /// Scope of one call. @param stream the caller's CUDA stream; NULL on the CPU, else throws ArgumentError
  class Call {
   public:
    Call(Place& place, void* stream);

   private:
    std::optional<CudaCall> cuda_;
  };

  /// Workspaces of calls without a handle, kept as long as this place.
  Photometric& photometric() { return photometric_ ? *photometric_ : photometric_.emplace(device()); }
  CudaSsimWorkspace& ssim_workspace() { return ssim_ ? *ssim_ : ssim_.emplace(*stream_); }

  /// A tensor as a span. Throws ArgumentError unless its device, type, shape (one of `wanted`) and strides are right.
  template <class T>
  std::span<T> view(const sb_tensor* tensor, const char* name, std::initializer_list<Shape> wanted) const {
    const std::size_t n = check(need(tensor, name), name, kTypeOf<std::remove_const_t<T>>, wanted);
    return {static_cast<T*>(tensor->data), n};
  }
  template <class T>
  std::span<T> view(const sb_tensor* tensor, const char* name, Shape wanted) const {
    return view<T>(tensor, name, {wanted});
  }
  /// The same; an empty span if the tensor is NULL.
  template <class T>
  std::span<T> optional_view(const sb_tensor* tensor, const char* name, std::initializer_list<Shape> wanted) const {
    return tensor == nullptr ? std::span<T>() : view<T>(tensor, name, wanted);
  }
  template <class T>
  std::span<T> optional_view(const sb_tensor* tensor, const char* name, Shape wanted) const {
    return optional_view<T>(tensor, name, {wanted});
  }

  /// @param drawn whether to read opacities, colors and features too
  Gaussians gaussians(const sb_gaussians* gaussians, bool drawn) const;
  /// The ground truth of a render [3,H,W], which must have the same size.
  TruthImage truth(const sb_truth* truth, const sb_tensor* render) const;

 private:
  std::size_t check(const sb_tensor& tensor, const char* name, std::int32_t type,
                    std::initializer_list<Shape> wanted) const;
  std::int32_t kind_ = SB_CPU, index_ = 0;
  Threads threads_;
  std::optional<CudaStream> stream_;  ///< borrows the caller's stream during a call
  std::optional<Photometric> photometric_;
  std::optional<CudaSsimWorkspace> ssim_;
};

/// Host access to the values of a tensor: in place on the CPU, through a copy for a GPU.
template <class T>
class OnHost {
 public:
  OnHost(std::span<T> values, Device device) : values_(values), device_(device) {
    if (!device.is_cuda()) return;
    copy_.resize(values.size());
    device.stream().copy_to_host(copy_.data(), values.data(), values.size_bytes());
  }
  std::span<T> span() { return device_.is_cuda() ? std::span<T>(copy_) : values_; }
  void write_back() {
    if (device_.is_cuda()) device_.stream().copy_to_device(values_.data(), copy_.data(), values_.size_bytes());
  }

 private:
  std::span<T> values_;
  Device device_;
  std::vector<std::remove_const_t<T>> copy_;
};

/// The place of a call without a handle. On a GPU, places and their workspaces are reused by later calls.
class BorrowedPlace {
 public:
  explicit BorrowedPlace(const sb_device* device);
  ~BorrowedPlace();
  BorrowedPlace(const BorrowedPlace&) = delete;
  BorrowedPlace& operator=(const BorrowedPlace&) = delete;
  Place& operator*() { return *place_; }

 private:
  std::unique_ptr<Place> place_;
};

/// Runs the body of an entry without a handle, passing it a place.
template <class Body>
sb_status guarded_on(const sb_device* device, Body&& body) noexcept {
  return guarded([&] {
    BorrowedPlace place(device);
    const Place::Call call(*place, device != nullptr ? device->stream : nullptr);
    body(*place);
  });
}

/// The size of a dimension that other tensors must match, such as the number of rows. Throws ArgumentError if there is
/// no such dimension.
std::int64_t size_of(const sb_tensor* tensor, const char* name, int dimension = 0);

/// Reads spherical harmonics or colors of n primitives from `given` (sb_gaussians, sb_convexes) into `out`.
template <class Given, class Primitives>
void colors_of(const Place& place, const Given& given, std::int64_t n, Primitives& out) {
  out.sh_dc = place.optional_view<const float>(given.sh_dc, "sh_dc", {{n, 3}, {n, 1, 3}});
  out.sh_rest = place.optional_view<const float>(given.sh_rest, "sh_rest", {n, kAny, 3});
  out.colors = place.optional_view<const float>(given.colors, "colors", {n, 3});
  if ((given.sh_dc != nullptr) == (given.colors != nullptr)) {
    throw ArgumentError("give either spherical harmonics (sh_dc, sh_rest) or colors");
  }
  if (given.sh_dc != nullptr) {
    SPLATBOOST_CHECK(given.sh_degree >= 0 && given.sh_degree <= kMaxShDegree,
                     "sh_degree must be 0 to 3, not " + std::to_string(given.sh_degree));
    out.sh_degree = given.sh_degree;
  }
  if (given.sh_rest != nullptr) {
    SPLATBOOST_CHECK(given.sh_dc != nullptr, "sh_rest needs sh_dc");
    SPLATBOOST_CHECK(given.sh_rest->shape[1] <= 1024, "sh_rest: at most 1024 coefficients");
    out.sh_rest_rows = static_cast<int>(given.sh_rest->shape[1]);
  }
  SPLATBOOST_CHECK(out.sh_rest_rows >= sh_coefficients(out.sh_degree) - 1,
                   "sh_rest: expected " + std::to_string(sh_coefficients(out.sh_degree) - 1) +
                       " coefficients for sh_degree " + std::to_string(out.sh_degree) + ", got " +
                       std::to_string(out.sh_rest_rows));
}

/// Copies within the device.
template <class T>
void copy(std::span<const T> from, std::span<T> to, Device device) {
  if (device.is_cuda()) {
    device.stream().copy_on_device(to.data(), from.data(), from.size_bytes());
  } else {
    std::copy(from.begin(), from.end(), to.begin());
  }
}

Camera camera_of(const sb_camera* camera);
RasterOptions options_of(const sb_raster_options* options);

}  // namespace splatboost::edge
