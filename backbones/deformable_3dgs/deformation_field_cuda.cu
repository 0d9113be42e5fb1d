// SPDX-License-Identifier: Apache-2.0
#include <utility>

#include "deformable_3dgs/deformation_field.h"
#include "deformable_3dgs/deformation_math.h"
#include "device/device_view.h"
#include "device/launch.h"
#include "families/nets/deep_net_cuda.h"
#include "families/nets/frequency_encoding.h"
#include "families/nets/smooth_functions.h"
#include "families/nets/two_layer_net_cuda.h"

namespace splatboost::cuda {
namespace {

/// Column `column` of the frequency encoding of `width` coordinates.
__device__ float encoded_column(const float* x, std::size_t width, std::size_t column) {
  if (column < width) return x[column];
  const std::size_t function = (column - width) / width;  // sine, cosine of the first frequency, sine of the second …
  float power = 1;
  for (std::size_t k = 0; k < function / 2; ++k) power *= 2;
  float sine = 0, cosine = 0;
  smooth_sine_cosine(x[(column - width) % width] * power, sine, cosine);
  return function % 2 == 0 ? sine : cosine;
}

__global__ void __launch_bounds__(kBlockThreads)
    encode_positions_kernel(DeviceView<const float> means, std::size_t width, DeviceView<float> x) {
  const std::size_t i = element_index();
  if (i >= x.size()) return;
  const std::size_t row = i / width;
  const float mean[3] = {means[3 * row], means[3 * row + 1], means[3 * row + 2]};
  x[i] = encoded_column(mean, 3, i % width);
}

__global__ void __launch_bounds__(kBlockThreads) encode_time_kernel(float time, DeviceView<float> encoded) {
  const std::size_t i = element_index();
  if (i < encoded.size()) encoded[i] = encoded_column(&time, 1, i);
}

template <class T>
struct PlacesView {
  DeviceView<T> means, scales, rotations;
};

/// A Gaussian's values in registers.
struct Place {
  float mean[3], scale[3], rotation[4];
  __device__ GaussianRow<const float> row() const { return {mean, scale, rotation}; }
  __device__ GaussianRow<float> row() { return {mean, scale, rotation}; }
};

// Filled through a reference: nvcc 13.0 has miscompiled returned structs with arrays (convexes/convex_math.h).
template <class T>
__device__ void read_place(const PlacesView<T>& places, std::size_t i, Place& place) {
  for (std::size_t c = 0; c < 3; ++c) {
    place.mean[c] = places.means[3 * i + c];
    place.scale[c] = places.scales[3 * i + c];
  }
  for (std::size_t c = 0; c < 4; ++c) place.rotation[c] = places.rotations[4 * i + c];
}

__device__ void write_place(const PlacesView<float>& places, std::size_t i, const Place& place) {
  for (std::size_t c = 0; c < 3; ++c) {
    places.means[3 * i + c] = place.mean[c];
    places.scales[3 * i + c] = place.scale[c];
  }
  for (std::size_t c = 0; c < 4; ++c) places.rotations[4 * i + c] = place.rotation[c];
}

constexpr std::size_t kMaxDeltas = 13;

__global__ void __launch_bounds__(kBlockThreads)
    move_gaussians_kernel(std::size_t count, std::size_t motion, PlacesView<const float> at,
                          DeviceView<const float> deltas, PlacesView<float> moved) {
  const std::size_t i = element_index(), width = delta_width(motion);
  if (i >= count) return;
  float delta[kMaxDeltas];
  for (std::size_t c = 0; c < width; ++c) delta[c] = deltas[width * i + c];
  Place here, there;
  read_place(at, i, here);
  move_gaussian<float>(motion, std::as_const(here).row(), delta, there.row());
  write_place(moved, i, there);
}

__global__ void __launch_bounds__(kBlockThreads)
    move_gaussians_backward_kernel(std::size_t count, std::size_t motion, PlacesView<const float> at,
                                   DeviceView<const float> deltas, PlacesView<const float> given,
                                   DeviceView<float> of_deltas, PlacesView<float> of_gaussians) {
  const std::size_t i = element_index(), width = delta_width(motion);
  if (i >= count) return;
  float delta[kMaxDeltas], of_delta[kMaxDeltas];
  for (std::size_t c = 0; c < width; ++c) delta[c] = deltas[width * i + c];
  Place here, g, sums;
  read_place(at, i, here);
  read_place(given, i, g);
  read_place(of_gaussians, i, sums);
  move_gaussian_backward<float>(motion, std::as_const(here).row(), delta, std::as_const(g).row(), of_delta, sums.row());
  write_place(of_gaussians, i, sums);
  for (std::size_t c = 0; c < width; ++c) of_deltas[width * i + c] = of_delta[c];
}

template <class T>
PlacesView<T> view_of(const GaussianPlaces<T>& places) {
  return {places.means, places.scales, places.rotations};
}

class FieldOnCuda final : public DeformationField::Work {
 public:
  FieldOnCuda(const DeformationShape& shape, CudaStream& stream)
      : shape_(shape),
        net_shape_(shape.net()),
        time_shape_(shape.time_shape()),
        stream_(stream),
        nets_(stream),
        net_(net_shape_, stream, nets_.matrices()),
        x_(stream),
        time_inputs_(stream),
        time_hidden_(stream),
        shared_(stream),
        of_shared_(stream),
        of_hidden_(stream),
        of_inputs_(stream),
        deltas_(stream),
        of_deltas_(stream) {
    shared_.ensure(net_shape_.shared);
    of_shared_.ensure(net_shape_.shared);
    time_inputs_.ensure(time_shape_.inputs);
    time_hidden_.ensure(time_shape_.hidden);
    of_hidden_.ensure(time_shape_.hidden);
    of_inputs_.ensure(time_shape_.inputs);
  }

  void forward(std::span<const float> parameters, const GaussianPlaces<const float>& at, float time,
               const GaussianPlaces<float>& moved, bool keep) override {
    const std::size_t n = at.means.size() / 3, width = delta_width(shape_.motion());
    const std::span<float> encoded = shape_.time_net ? time_inputs_.span() : shared_.span();
    launch_each(stream_, "encode_time", encode_time_kernel, encoded.size(), time, encoded);
    if (shape_.time_net) {
      nets_.forward(time_shape_, parameters.subspan(net_shape_.parameters()), 1, time_inputs_.span(), Activation::none,
                    time_hidden_.span(), shared_.span());
    }
    x_.ensure(n * net_shape_.inputs);
    deltas_.ensure(n * width);
    launch_each(stream_, "encode_positions", encode_positions_kernel, x_.size(), at.means, net_shape_.inputs,
                x_.span());
    net_.forward(parameters.first(net_shape_.parameters()), shared_.span(), n, x_.span(), deltas_.span(), keep);
    launch_each(stream_, "move_gaussians", move_gaussians_kernel, n, n, shape_.motion(), view_of(at), deltas_.span(),
                view_of(moved));
  }

  void backward(std::span<const float> parameters, const GaussianPlaces<const float>& at,
                const GaussianPlaces<const float>& given, const GaussianPlaces<float>& of_gaussians,
                std::span<float> of_parameters) override {
    const std::size_t n = at.means.size() / 3, width = delta_width(shape_.motion());
    of_deltas_.ensure(n * width);
    launch_each(stream_, "move_gaussians_backward", move_gaussians_backward_kernel, n, n, shape_.motion(), view_of(at),
                deltas_.span(), view_of(given), of_deltas_.span(), view_of(of_gaussians));
    net_.backward(parameters.first(net_shape_.parameters()), shared_.span(), x_.span(), of_deltas_.span(),
                  of_parameters.first(net_shape_.parameters()), of_shared_.span());
    if (!shape_.time_net) return;
    nets_.backward(time_shape_, parameters.subspan(net_shape_.parameters()), 1, time_inputs_.span(),
                   time_hidden_.span(), of_shared_.span(), of_hidden_.span(),
                   of_parameters.subspan(net_shape_.parameters()), of_inputs_.span());
  }

 private:
  DeformationShape shape_;
  DeepNetShape net_shape_;
  NetShape time_shape_;
  CudaStream& stream_;
  CudaNets nets_;
  CudaDeepNet net_;
  DeviceArray<float> x_;                          ///< [N,inputs] encoded means
  DeviceArray<float> time_inputs_, time_hidden_;  ///< of the time net
  DeviceArray<float> shared_, of_shared_, of_hidden_, of_inputs_;
  DeviceArray<float> deltas_, of_deltas_;  ///< [N, delta_width()]
};

}  // namespace

std::unique_ptr<DeformationField::Work> make_deformation_field(const DeformationShape& shape, CudaStream& stream) {
  return std::make_unique<FieldOnCuda>(shape, stream);
}

}  // namespace splatboost::cuda
