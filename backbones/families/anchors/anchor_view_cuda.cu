// SPDX-License-Identifier: Apache-2.0
// The number of anchors in view is known on the device only, and the host does not wait for it. So a view has more rows
// than needed: the anchors in view come first, then padding rows of zeros, whose slots are not drawn.
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "device/device_view.h"
#include "device/launch.h"
#include "device/readbacks.h"
#include "device/run_cub.h"
#include "families/anchors/anchor_prefilter_math.h"
#include "families/anchors/cuda_anchors.h"
#include "families/anchors/decoder_math.h"
#include "families/nets/two_layer_net_cuda.h"

namespace splatboost::cuda {
namespace {

/// `places` has one entry more than there are anchors: after the prefix sum the last one is the number in view.
__global__ void __launch_bounds__(kBlockThreads)
    anchors_in_view_kernel(AnchorScreen screen, DeviceView<const float> positions, DeviceView<const float> scales,
                           DeviceView<const std::uint8_t> usable, DeviceView<std::uint32_t> places) {
  const std::size_t i = element_index();
  if (i >= places.size()) return;
  const bool is_anchor = i + 1 < places.size() && (usable.empty() || usable[i] != 0);
  bool seen = false;
  if (is_anchor) {
    const float position[3] = {positions[3 * i], positions[3 * i + 1], positions[3 * i + 2]};
    const float scale[3] = {scales[6 * i], scales[6 * i + 1], scales[6 * i + 2]};
    seen = sees_anchor(screen, position, scale);
  }
  places[i] = seen ? 1 : 0;
}

__global__ void __launch_bounds__(kBlockThreads)
    list_anchors_kernel(DeviceView<const std::uint32_t> places, DeviceView<std::uint32_t> anchors) {
  const std::size_t i = element_index(), n = places.size() - 1;
  if (i >= n) return;
  const std::size_t place = places[i];
  if (places[i + 1] != place && place < anchors.size()) anchors[place] = static_cast<std::uint32_t>(i);
  if (i >= places[n] && i < anchors.size()) anchors[i] = kNothing;
}

struct Centre {
  float at[3];
};

__global__ void __launch_bounds__(kBlockThreads)
    view_anchors_kernel(DeviceView<const std::uint32_t> anchors, DeviceView<const float> positions, Centre centre,
                        DeviceView<float> views) {
  const std::size_t v = element_index();
  if (v >= anchors.size()) return;
  const std::size_t a = anchors[v];
  float view[4] = {0, 0, 0, 0};
  if (a != kNothing) {
    const float position[3] = {positions[3 * a], positions[3 * a + 1], positions[3 * a + 2]};
    view_anchor(position, centre.at, view);
  }
  for (std::size_t c = 0; c < 4; ++c) views[4 * v + c] = view[c];
}

/// Input columns of a net: the feature (not for the bank's net); the direction and, if used, the distance; the level;
/// the view's embedding.
struct InputColumns {
  DeviceView<const std::uint32_t> anchors;
  DeviceView<const float> features, views, bank, levels, embedding;
  std::size_t feature_width;  ///< 0 for the bank's net
  std::size_t view_width;     ///< 3, or 4 with the distance
  std::size_t width;          ///< total

  __device__ float at(std::size_t v, std::size_t c) const {
    const std::size_t a = anchors[v];
    if (a == kNothing) return 0.0f;
    if (c < feature_width) {
      const float* const feature = &features[feature_width * a];
      if (bank.empty()) return feature[c];
      const float w[3] = {bank[3 * v], bank[3 * v + 1], bank[3 * v + 2]};
      return mixed_channel(feature, w, c, feature_width);
    }
    c -= feature_width;
    if (c < view_width) return views[4 * v + c];
    c -= view_width;
    if (!levels.empty()) {
      if (c == 0) return levels[a];
      --c;
    }
    return embedding[c];
  }
};

__global__ void __launch_bounds__(kBlockThreads) pack_inputs_kernel(InputColumns columns, DeviceView<float> x) {
  const std::size_t i = element_index();
  if (i < x.size()) x[i] = columns.at(i / columns.width, i % columns.width);
}

__global__ void __launch_bounds__(kBlockThreads) softmax_kernel(DeviceView<float> bank) {
  const std::size_t v = element_index();
  if (3 * v >= bank.size()) return;
  float w[3] = {bank[3 * v], bank[3 * v + 1], bank[3 * v + 2]};
  softmax(w);
  for (std::size_t c = 0; c < 3; ++c) bank[3 * v + c] = w[c];
}

/// Output Gaussians, one row per slot of an anchor in view.
struct OfferedGaussians {
  DeviceView<float> means, scales, rotations, opacities, colors, volumes;
  DeviceView<std::uint32_t> slots;
  DeviceView<std::uint8_t> drawn;
};

__global__ void __launch_bounds__(kBlockThreads)
    offer_gaussians_kernel(DeviceView<const std::uint32_t> anchors, std::size_t k, DeviceView<const float> positions,
                           DeviceView<const float> offsets, DeviceView<const float> sizes,
                           DeviceView<const float> opacities, DeviceView<const float> shapes,
                           DeviceView<const float> colors, OfferedGaussians out) {
  const std::size_t i = element_index();
  if (i >= out.slots.size()) return;
  const std::size_t a = anchors[i / k];
  const bool drawn = a != kNothing && opacities[i] > 0.0f;
  const std::size_t slot = a * k + i % k;
  out.drawn[i] = drawn ? 1 : 0;
  out.slots[i] = drawn ? static_cast<std::uint32_t>(slot) : kNothing;
  out.opacities[i] = drawn ? opacities[i] : -1.0f;
  float volume = drawn ? 1.0f : 0.0f;
  for (std::size_t c = 0; c < 3; ++c) {
    float mean = 0, scale = 1, color = 0;
    if (drawn) {
      mean = slot_mean(positions[3 * a + c], offsets[3 * slot + c], sizes[6 * a + c]);
      scale = slot_scale(sizes[6 * a + 3 + c], shapes[7 * i + c]);
      color = colors[3 * i + c];
    }
    out.means[3 * i + c] = mean;
    out.scales[3 * i + c] = scale;
    out.colors[3 * i + c] = color;
    volume *= scale;
  }
  for (std::size_t c = 0; c < 4; ++c) out.rotations[4 * i + c] = drawn ? shapes[7 * i + 3 + c] : 0.5f;
  out.volumes[i] = volume;
}

/// @param totals sum of the volumes, and number of Gaussians drawn
__global__ void __launch_bounds__(kBlockThreads)
    volume_gradient_kernel(float weight, DeviceView<const double> totals, DeviceView<const std::uint32_t> slots,
                           DeviceView<const float> scales, DeviceView<float> gradients) {
  const std::size_t i = element_index();
  if (i >= slots.size() || slots[i] == kNothing) return;
  const float share = weight / static_cast<float>(totals[1]);
  const float x = scales[3 * i], y = scales[3 * i + 1], z = scales[3 * i + 2];
  gradients[3 * i] += share * y * z;
  gradients[3 * i + 1] += share * x * z;
  gradients[3 * i + 2] += share * x * y;
}

/// Gradients with respect to the Gaussians, as kernel arguments.
struct GivenGradients {
  DeviceView<const float> means, scales, rotations, opacities, colors;
  explicit GivenGradients(const NeuralGaussianGradients<float>& g)
      : means(g.means), scales(g.scales), rotations(g.rotations), opacities(g.opacities), colors(g.colors) {}
};

/// Gradients with respect to a slot's offset and to the outputs of the nets, from those of its Gaussian. Each slot
/// occurs once in the view.
__global__ void __launch_bounds__(kBlockThreads)
    slot_gradients_kernel(DeviceView<const std::uint32_t> slots, std::size_t k, GivenGradients given,
                          DeviceView<const float> sizes, DeviceView<const float> opacities,
                          DeviceView<const float> scales, DeviceView<const float> colors, DeviceView<float> by_offsets,
                          DeviceView<float> by_opacities, DeviceView<float> by_shapes, DeviceView<float> by_colors) {
  const std::size_t i = element_index();
  if (i >= slots.size()) return;
  const std::size_t slot = slots[i];
  const bool drawn = slot != kNothing;
  const std::size_t a = slot / k;
  by_opacities[i] = drawn ? tanh_gradient(given.opacities[i], opacities[i]) : 0.0f;
  for (std::size_t c = 0; c < 3; ++c) {
    float by_color = 0, by_shape = 0;
    if (drawn) {
      by_color = sigmoid_gradient(given.colors[3 * i + c], colors[3 * i + c]);
      by_offsets[3 * slot + c] += given.means[3 * i + c] * sizes[6 * a + c];
      const float scale = scales[3 * i + c];
      by_shape = raw_scale_gradient(given.scales[3 * i + c] * scale, scale, sizes[6 * a + 3 + c]);
    }
    by_colors[3 * i + c] = by_color;
    by_shapes[7 * i + c] = by_shape;
  }
  for (std::size_t c = 0; c < 4; ++c) by_shapes[7 * i + 3 + c] = drawn ? given.rotations[4 * i + c] : 0.0f;
}

/// Gradient with respect to one of the six log scales of an anchor in view, summed over its slots in order.
__global__ void __launch_bounds__(kBlockThreads)
    size_gradients_kernel(DeviceView<const std::uint32_t> anchors, DeviceView<const std::uint32_t> slots, std::size_t k,
                          GivenGradients given, DeviceView<const float> offsets, DeviceView<const float> sizes,
                          DeviceView<const float> scales, DeviceView<float> by_log_sizes) {
  const std::size_t v = element_index() / 6, c = element_index() % 6;
  if (v >= anchors.size() || anchors[v] == kNothing) return;
  const std::size_t a = anchors[v];
  float sum = 0;
  for (std::size_t i = k * v; i < k * (v + 1); ++i) {
    if (slots[i] == kNothing) continue;
    if (c < 3) {
      sum += given.means[3 * i + c] * sizes[6 * a + c] * offsets[3 * static_cast<std::size_t>(slots[i]) + c];
    } else {
      sum += given.scales[3 * i + c - 3] * scales[3 * i + c - 3];
    }
  }
  by_log_sizes[6 * a + c] += sum;
}

/// Sums the feature columns of the input gradients over the nets.
__global__ void __launch_bounds__(kBlockThreads)
    add_by_features_kernel(DeviceView<const float> x_gradient, std::size_t inputs, std::size_t width, bool first,
                           DeviceView<float> by_mixed) {
  const std::size_t i = element_index();
  if (i >= by_mixed.size()) return;
  const float value = x_gradient[i / width * inputs + i % width];
  by_mixed[i] = first ? value : by_mixed[i] + value;
}

/// Gradients with respect to the anchors' features. @param bank empty if features are not mixed
__global__ void __launch_bounds__(kBlockThreads)
    feature_gradients_kernel(DeviceView<const std::uint32_t> anchors, std::size_t width, DeviceView<const float> bank,
                             DeviceView<const float> by_mixed, DeviceView<float> by_features) {
  const std::size_t i = element_index();
  if (i >= by_mixed.size()) return;
  const std::size_t v = i / width, c = i % width;
  const std::size_t a = anchors[v];
  if (a == kNothing) return;
  if (bank.empty()) {
    by_features[width * a + c] += by_mixed[i];
    return;
  }
  // Sum over the mixed channels that read this one: one per period of each resolution.
  float sum = bank[3 * v + 2] * by_mixed[i];
  const std::size_t quarter = width / 4, half = width / 2;
  if (c % 2 == 0) {
    for (std::size_t m = c / 2; m < width; m += half) sum += bank[3 * v + 1] * by_mixed[width * v + m];
  }
  if (c % 4 == 0) {
    for (std::size_t m = c / 4; m < width; m += quarter) sum += bank[3 * v] * by_mixed[width * v + m];
  }
  by_features[width * a + c] += sum;
}

/// Gradients with respect to the inputs of the softmax of the bank's weights.
__global__ void __launch_bounds__(kBlockThreads)
    bank_gradients_kernel(DeviceView<const std::uint32_t> anchors, std::size_t width, DeviceView<const float> features,
                          DeviceView<const float> bank, DeviceView<const float> by_mixed, DeviceView<float> by_bank) {
  const std::size_t v = element_index();
  if (v >= anchors.size()) return;
  const std::size_t a = anchors[v];
  float by_weight[3] = {0, 0, 0};
  for (std::size_t c = 0; a != kNothing && c < width; ++c) {
    const float g = by_mixed[width * v + c];
    by_weight[0] += features[width * a + coarse_channel(c, width)] * g;
    by_weight[1] += features[width * a + middle_channel(c, width)] * g;
    by_weight[2] += features[width * a + c] * g;
  }
  float mean = 0;
  for (std::size_t i = 0; i < 3; ++i) mean += bank[3 * v + i] * by_weight[i];
  for (std::size_t i = 0; i < 3; ++i) by_bank[3 * v + i] = bank[3 * v + i] * (by_weight[i] - mean);
}

/// Number of rows to allocate for a view: 1.5 times the largest need of the views with known numbers, where need is the
/// larger of the share of all anchors and the absolute number.
class RowsOfViews {
 public:
  explicit RowsOfViews(CudaStream& stream) : numbers_(stream) {}

  /// @param in_view number of anchors in view, in device memory @param anchors number of all anchors
  std::size_t next(const std::uint32_t* in_view, std::size_t anchors, bool ahead) {
    if (numbers_.is_full()) note(numbers_.wait());
    numbers_.send(in_view);
    anchors_of_[sent_++ % kMaxUnderWay] = anchors;
    while (const std::optional<std::uint32_t> number = numbers_.take()) note(*number);
    while (!ahead && !numbers_.is_empty()) note(numbers_.wait());
    if (ahead && known_ < forgotten_ + kViewsWithAll) return anchors;
    const double most = std::max(largest_share_ * static_cast<double>(anchors), static_cast<double>(largest_));
    // Rounded up to a multiple of kGrain with some to spare, so that few matrix shapes occur.
    const std::size_t rows = (static_cast<std::size_t>(kRoomFactor * most) / kGrain + 2) * kGrain;
    return std::min(anchors, rows);
  }
  void forget() {
    forgotten_ = sent_;
    largest_share_ = 0;
    largest_ = 0;
  }

 private:
  static constexpr double kRoomFactor = 1.5;
  static constexpr std::size_t kGrain = 32;
  static constexpr std::size_t kViewsWithAll = 64;
  static constexpr std::size_t kMaxUnderWay = 64;

  void note(std::uint32_t in_view) {
    const std::size_t anchors = anchors_of_[known_++ % kMaxUnderWay];
    if (known_ <= forgotten_) return;
    largest_ = std::max(largest_, in_view);
    if (anchors == 0) return;
    largest_share_ = std::max(largest_share_, static_cast<double>(in_view) / static_cast<double>(anchors));
  }

  Readbacks<std::uint32_t, kMaxUnderWay> numbers_;
  std::array<std::size_t, kMaxUnderWay> anchors_of_{};  ///< of the views whose numbers are in transit
  std::size_t sent_ = 0, known_ = 0;                    ///< counts of numbers
  std::size_t forgotten_ = 0;                           ///< this many first numbers are ignored, see forget()
  double largest_share_ = 0;                            ///< of all anchors, in any view
  std::uint32_t largest_ = 0;
};

class WorkOnCuda final : public AnchorView::Work {
 public:
  WorkOnCuda(const DecoderShape& shape, CudaStream& stream)
      : shape_(shape), stream_(stream), nets_(stream), rows_(stream), volume_losses_(stream) {
    totals_.ensure(2);
  }

  const ViewGaussians& decode(const Camera& camera, const DecoderInputs<float>& inputs,
                              std::span<const std::uint8_t> usable, bool ahead) override {
    list_anchors(camera, inputs, usable, ahead);
    const std::size_t n = anchors_.size(), k = shape_.offsets;
    const glm::vec3 centre = camera.centre();
    views_.ensure(4 * n);
    launch_each(stream_, "view_anchors", view_anchors_kernel, n, anchors_.span(), inputs.positions,
                Centre{{centre.x, centre.y, centre.z}}, views_.span());
    if (shape_.feature_bank) {
      run_net(shape_.bank(), bank_columns(inputs), inputs.bank_net, Activation::none, bank_hidden_, bank_);
      launch_each(stream_, "softmax", softmax_kernel, n, bank_.span());
    }
    run_net(shape_.opacity(), opacity_columns(inputs), inputs.opacity_net, Activation::tanh, opacity_hidden_, opacity_);
    run_net(shape_.covariance(), covariance_columns(inputs), inputs.covariance_net, Activation::none,
            covariance_hidden_, covariance_);
    run_net(shape_.color(), color_columns(inputs), inputs.color_net, Activation::sigmoid, color_hidden_, color_);

    const std::size_t m = n * k;
    for (DeviceArray<float>* vectors : {&means_, &scales_, &colors_}) vectors->ensure(3 * m);
    rotations_.ensure(4 * m);
    opacities_.ensure(m);
    volumes_.ensure(m);
    slots_.ensure(m);
    drawn_.ensure(m);
    const OfferedGaussians out{means_.span(),  scales_.span(),  rotations_.span(), opacities_.span(),
                               colors_.span(), volumes_.span(), slots_.span(),     drawn_.span()};
    launch_each(stream_, "offer_gaussians", offer_gaussians_kernel, m, anchors_.span(), k, inputs.positions,
                inputs.offsets, inputs.scales, opacity_.span(), covariance_.span(), color_.span(), out);
    gaussians_ = {m,
                  means_.span(),
                  scales_.span(),
                  rotations_.span(),
                  opacities_.span(),
                  colors_.span(),
                  slots_.span(),
                  anchors_.span(),
                  opacity_.span()};
    return gaussians_;
  }

  void forget_views() override { rows_.forget(); }

  double add_volume_loss(double weight, std::span<float> scale_gradients, bool ahead) override {
    const std::size_t m = gaussians_.count;
    const auto sum = [&](const auto& values, double* total) {
      run_cub(stream_, scratch_, "cub::Sum of volumes", [&](void* memory, std::size_t& bytes) {
        return cub::DeviceReduce::Sum(memory, bytes, values.data(), total, static_cast<std::int64_t>(m),
                                      handle_of(stream_));
      });
    };
    sum(volumes_, totals_.data());
    sum(drawn_, totals_.data() + 1);
    launch_each(stream_, "volume_gradient", volume_gradient_kernel, m, static_cast<float>(weight), totals_.span(),
                slots_.span(), scales_.span(), scale_gradients);

    const auto note = [&](const std::array<double, 2>& totals) {
      if (!std::isfinite(newest_volume_loss_)) return;  // keep the first loss that is not finite
      newest_volume_loss_ = totals[1] > 0 ? weight * totals[0] / totals[1] : 0;
    };
    if (volume_losses_.is_full()) note(volume_losses_.wait());
    volume_losses_.send(totals_.data());
    while (const std::optional<std::array<double, 2>> totals = volume_losses_.take()) note(*totals);
    while (!ahead && !volume_losses_.is_empty()) note(volume_losses_.wait());
    return newest_volume_loss_;
  }

  void backward(const DecoderInputs<float>& inputs, const NeuralGaussianGradients<float>& given,
                const DecoderGradients<float>& gradients) override {
    const std::size_t n = anchors_.size(), k = shape_.offsets, m = n * k, width = shape_.features;
    by_opacities_.ensure(m);
    by_shapes_.ensure(7 * m);
    by_colors_.ensure(3 * m);
    launch_each(stream_, "slot_gradients", slot_gradients_kernel, m, slots_.span(), k, GivenGradients(given),
                inputs.scales, opacity_.span(), scales_.span(), color_.span(), gradients.offsets, by_opacities_.span(),
                by_shapes_.span(), by_colors_.span());
    launch_each(stream_, "size_gradients", size_gradients_kernel, 6 * n, anchors_.span(), slots_.span(), k,
                GivenGradients(given), inputs.offsets, inputs.scales, scales_.span(), gradients.log_scales);

    by_mixed_.ensure(n * width);
    run_net_backward(shape_.opacity(), opacity_columns(inputs), inputs.opacity_net, opacity_hidden_, by_opacities_,
                     gradients.opacity_net);
    add_by_features(shape_.opacity(), true);
    run_net_backward(shape_.covariance(), covariance_columns(inputs), inputs.covariance_net, covariance_hidden_,
                     by_shapes_, gradients.covariance_net);
    add_by_features(shape_.covariance(), false);
    const NetShape color = shape_.color();
    run_net_backward(color, color_columns(inputs), inputs.color_net, color_hidden_, by_colors_, gradients.color_net);
    add_by_features(color, false);
    if (!gradients.embedding.empty()) {
      nets_.matrices().add_column_sums(by_x_.span(), n, color.inputs, color.inputs - shape_.appearance,
                                       gradients.embedding);
    }
    launch_each(stream_, "feature_gradients", feature_gradients_kernel, n * width, anchors_.span(), width, bank_.span(),
                by_mixed_.span(), gradients.features);
    if (!shape_.feature_bank) return;
    by_bank_.ensure(3 * n);
    launch_each(stream_, "bank_gradients", bank_gradients_kernel, n, anchors_.span(), width, inputs.features,
                bank_.span(), by_mixed_.span(), by_bank_.span());
    run_net_backward(shape_.bank(), bank_columns(inputs), inputs.bank_net, bank_hidden_, by_bank_, gradients.bank_net);
  }

 private:
  void list_anchors(const Camera& camera, const DecoderInputs<float>& inputs, std::span<const std::uint8_t> usable,
                    bool ahead) {
    const std::size_t n = inputs.positions.size() / 3;
    places_.ensure(n + 1);
    launch_each(stream_, "anchors_in_view", anchors_in_view_kernel, n + 1, AnchorScreen(camera), inputs.positions,
                inputs.scales, usable, places_.span());
    run_cub(stream_, scratch_, "cub::ExclusiveSum of anchors", [&](void* memory, std::size_t& bytes) {
      return cub::DeviceScan::ExclusiveSum(memory, bytes, places_.data(), places_.data(),
                                           static_cast<std::int64_t>(n + 1), handle_of(stream_));
    });
    anchors_.ensure(rows_.next(places_.data() + n, n, ahead));
    launch_each(stream_, "list_anchors", list_anchors_kernel, n, places_.span(), anchors_.span());
  }

  InputColumns columns(const DecoderInputs<float>& inputs, const NetShape& net, bool distance) const {
    InputColumns made{anchors_.span(), inputs.features, views_.span(), bank_.span(), {}, {}, 0, 0, 0};
    if (shape_.level) made.levels = inputs.levels;
    made.feature_width = shape_.features;
    made.view_width = distance ? 4 : 3;
    made.width = net.inputs;
    return made;
  }
  InputColumns bank_columns(const DecoderInputs<float>& inputs) const {
    InputColumns made = columns(inputs, shape_.bank(), shape_.bank_distance);
    made.feature_width = 0;
    return made;
  }
  InputColumns opacity_columns(const DecoderInputs<float>& inputs) const {
    return columns(inputs, shape_.opacity(), shape_.opacity_distance);
  }
  InputColumns covariance_columns(const DecoderInputs<float>& inputs) const {
    return columns(inputs, shape_.covariance(), shape_.covariance_distance);
  }
  InputColumns color_columns(const DecoderInputs<float>& inputs) const {
    InputColumns made = columns(inputs, shape_.color(), shape_.color_distance);
    made.embedding = inputs.embedding;
    return made;
  }

  /// Writes the inputs of a net. The backward pass computes them again: storing them would double the memory.
  void pack(const NetShape& net, const InputColumns& columns) {
    x_.ensure(anchors_.size() * net.inputs);
    launch_each(stream_, "pack_inputs", pack_inputs_kernel, x_.size(), columns, x_.span());
  }
  void run_net(const NetShape& net, const InputColumns& columns, std::span<const float> parameters,
               Activation activation, DeviceArray<float>& hidden, DeviceArray<float>& y) {
    const std::size_t n = anchors_.size();
    pack(net, columns);
    hidden.ensure(n * net.hidden);
    y.ensure(n * net.outputs);
    nets_.forward(net, parameters, n, x_.span(), activation, hidden.span(), y.span());
  }
  void run_net_backward(const NetShape& net, const InputColumns& columns, std::span<const float> parameters,
                        const DeviceArray<float>& hidden, const DeviceArray<float>& by_y,
                        std::span<float> parameter_gradients) {
    const std::size_t n = anchors_.size();
    pack(net, columns);
    by_hidden_.ensure(n * net.hidden);
    by_x_.ensure(n * net.inputs);
    nets_.backward(net, parameters, n, x_.span(), hidden.span(), by_y.span(), by_hidden_.span(), parameter_gradients,
                   by_x_.span());
  }
  void add_by_features(const NetShape& net, bool first) {
    launch_each(stream_, "add_by_features", add_by_features_kernel, by_mixed_.size(), by_x_.span(), net.inputs,
                shape_.features, first, by_mixed_.span());
  }

  DecoderShape shape_;
  CudaStream& stream_;
  CudaNets nets_;
  RowsOfViews rows_;
  DeviceArray<std::uint8_t> scratch_{stream_};
  DeviceArray<std::uint32_t> places_{stream_};   ///< [N+1] number of anchors in view before each
  DeviceArray<std::uint32_t> anchors_{stream_};  ///< [V], V = number of rows of the view
  DeviceArray<float> views_{stream_};            ///< [V,4] direction and distance
  DeviceArray<float> x_{stream_};                ///< inputs of the current net
  DeviceArray<float> bank_{stream_};             ///< [V,3] weights of the feature bank; empty without one
  DeviceArray<float> opacity_{stream_}, covariance_{stream_}, color_{stream_};  ///< [V,k], [V,7k] raw, [V,3k]
  DeviceArray<float> bank_hidden_{stream_}, opacity_hidden_{stream_}, covariance_hidden_{stream_},
      color_hidden_{stream_};  ///< [V,F]

  // Gaussians, M = V·k of them.
  DeviceArray<float> means_{stream_}, scales_{stream_}, rotations_{stream_}, opacities_{stream_}, colors_{stream_};
  DeviceArray<float> volumes_{stream_};
  DeviceArray<std::uint32_t> slots_{stream_};
  DeviceArray<std::uint8_t> drawn_{stream_};
  ViewGaussians gaussians_;

  DeviceArray<double> totals_{stream_};  ///< sum of the volumes, and number of Gaussians drawn
  Readbacks<std::array<double, 2>> volume_losses_;
  double newest_volume_loss_ = 0;

  // Gradients with respect to the named quantities.
  DeviceArray<float> by_opacities_{stream_}, by_shapes_{stream_}, by_colors_{stream_}, by_bank_{stream_};
  DeviceArray<float> by_hidden_{stream_}, by_x_{stream_}, by_mixed_{stream_};
};

}  // namespace

std::unique_ptr<AnchorView::Work> make_anchor_view(const DecoderShape& shape, CudaStream& stream) {
  return std::make_unique<WorkOnCuda>(shape, stream);
}

}  // namespace splatboost::cuda
