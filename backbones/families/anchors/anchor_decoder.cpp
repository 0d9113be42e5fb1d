// SPDX-License-Identifier: Apache-2.0
#include "families/anchors/anchor_decoder.h"

#include <algorithm>

#include "families/anchors/decoder_math.h"

namespace splatboost {
namespace {

/// Anchors per block: their data fits into the L2 cache, and a view has enough blocks for many threads.
constexpr std::size_t kBlock = 256;
constexpr std::size_t kGrain = 4096;

}  // namespace

/// Buffers for one block, kept per thread so that blocks do not allocate.
template <class Real>
struct AnchorDecoder<Real>::Scratch {
  std::vector<Real> mixed, x, hidden_gradient, x_gradient, feature_gradient;
  std::vector<Real> opacity_gradient, covariance_gradient, color_gradient, bank_gradient;

  static Scratch& of_this_thread() {
    thread_local Scratch scratch;
    return scratch;
  }
  /// At least `size` values, uninitialised.
  static Real* room(std::vector<Real>& values, std::size_t size) {
    if (values.size() < size) values.resize(size);
    return values.data();
  }
  static Real* zeros(std::vector<Real>& values, std::size_t size) {
    values.assign(size, Real(0));
    return values.data();
  }
};

template <class Real>
std::size_t AnchorDecoder<Real>::all_net_parameters() const {
  return shape_.opacity().parameters() + shape_.covariance().parameters() + shape_.color().parameters() +
         (shape_.feature_bank ? shape_.bank().parameters() : 0) + shape_.appearance;
}

template <class Real>
void AnchorDecoder<Real>::pack_bank_input(const DecoderInputs<Real>& inputs, std::size_t begin, std::size_t end,
                                          Real* x) const {
  for (std::size_t v = begin; v < end; ++v) {
    x = std::copy_n(&view_[4 * v], shape_.bank_distance ? 4 : 3, x);
    if (shape_.level) *x++ = inputs.levels[anchors_[v]];
  }
}

template <class Real>
void AnchorDecoder<Real>::pack_features(const DecoderInputs<Real>& inputs, std::size_t begin, std::size_t end,
                                        Real* mixed) const {
  const std::size_t width = shape_.features;
  for (std::size_t v = begin; v < end; ++v, mixed += width) {
    const Real* f = &inputs.features[width * anchors_[v]];
    if (!shape_.feature_bank) {
      std::copy_n(f, width, mixed);
      continue;
    }
    const Real* w = &bank_[3 * v];
    for (std::size_t c = 0; c < width; ++c) mixed[c] = mixed_channel(f, w, c, width);
  }
}

template <class Real>
void AnchorDecoder<Real>::pack_input(const DecoderInputs<Real>& inputs, std::size_t begin, std::size_t end,
                                     const Real* mixed, bool distance, bool appearance, Real* x) const {
  for (std::size_t v = begin; v < end; ++v, mixed += shape_.features) {
    x = std::copy_n(mixed, shape_.features, x);
    x = std::copy_n(&view_[4 * v], distance ? 4 : 3, x);
    if (shape_.level) *x++ = inputs.levels[anchors_[v]];
    if (appearance) x = std::copy_n(inputs.embedding.data(), shape_.appearance, x);
  }
}

template <class Real>
const NeuralGaussians<Real>& AnchorDecoder<Real>::forward(const DecoderInputs<Real>& inputs,
                                                          std::span<const std::uint32_t> anchors,
                                                          const std::array<Real, 3>& centre) {
  const std::size_t count = anchors.size(), k = shape_.offsets, width = shape_.features;
  anchors_.assign(anchors.begin(), anchors.end());
  view_.resize(4 * count);
  opacity_.resize(k * count);
  covariance_.resize(7 * k * count);
  color_.resize(3 * k * count);
  for (std::vector<Real>* hidden : {&opacity_hidden_, &covariance_hidden_, &color_hidden_}) {
    hidden->resize(width * count);
  }
  if (shape_.feature_bank) {
    bank_.resize(3 * count);
    bank_hidden_.resize(width * count);
  }
  first_.resize(count + 1);

  threads_.for_range(count, kBlock, [&](std::size_t begin, std::size_t end) {
    const std::size_t rows = end - begin;
    Scratch& scratch = Scratch::of_this_thread();
    for (std::size_t v = begin; v < end; ++v) {
      view_anchor(&inputs.positions[3 * anchors_[v]], centre.data(), &view_[4 * v]);
    }
    if (shape_.feature_bank) {
      const NetShape net = shape_.bank();
      Real* x = Scratch::room(scratch.x, rows * net.inputs);
      pack_bank_input(inputs, begin, end, x);
      net_forward<Real>(net, inputs.bank_net, rows, x, &bank_hidden_[width * begin], &bank_[3 * begin]);
      for (std::size_t v = begin; v < end; ++v) softmax(&bank_[3 * v]);
    }
    Real* mixed = Scratch::room(scratch.mixed, rows * width);
    pack_features(inputs, begin, end, mixed);
    const auto run = [&](const NetShape& net, std::span<const Real> parameters, bool distance, bool appearance,
                         std::vector<Real>& hidden, std::vector<Real>& out) {
      Real* x = Scratch::room(scratch.x, rows * net.inputs);
      pack_input(inputs, begin, end, mixed, distance, appearance, x);
      net_forward<Real>(net, parameters, rows, x, &hidden[width * begin], &out[net.outputs * begin]);
    };
    run(shape_.opacity(), inputs.opacity_net, shape_.opacity_distance, false, opacity_hidden_, opacity_);
    run(shape_.covariance(), inputs.covariance_net, shape_.covariance_distance, false, covariance_hidden_, covariance_);
    run(shape_.color(), inputs.color_net, shape_.color_distance, true, color_hidden_, color_);
    tanh_all(std::span(opacity_).subspan(k * begin, k * rows));
    sigmoid_all(std::span(color_).subspan(3 * k * begin, 3 * k * rows));
    for (std::size_t v = begin; v < end; ++v) {
      const Real* o = &opacity_[k * v];
      first_[v + 1] = static_cast<std::uint32_t>(std::count_if(o, o + k, [](Real value) { return value > 0; }));
    }
  });
  first_[0] = 0;
  for (std::size_t v = 0; v < count; ++v) first_[v + 1] += first_[v];

  const std::size_t m = first_[count];
  NeuralGaussians<Real>& g = gaussians_;
  g.means.resize(3 * m);
  g.scales.resize(3 * m);
  g.rotations.resize(4 * m);
  g.opacities.resize(m);
  g.colors.resize(3 * m);
  g.slots.resize(m);
  threads_.for_range(count, kBlock, [&](std::size_t begin, std::size_t end) {
    for (std::size_t v = begin; v < end; ++v) {
      const std::size_t anchor = anchors_[v];
      const Real* size = &inputs.scales[6 * anchor];
      std::size_t to = first_[v];
      for (std::size_t j = 0; j < k; ++j) {
        const std::size_t of = k * v + j;
        if (!(opacity_[of] > 0)) continue;
        const Real* shape = &covariance_[7 * of];
        const Real* offset = &inputs.offsets[3 * (k * anchor + j)];
        for (std::size_t c = 0; c < 3; ++c) {
          g.means[3 * to + c] = slot_mean(inputs.positions[3 * anchor + c], offset[c], size[c]);
          g.scales[3 * to + c] = slot_scale(size[3 + c], shape[c]);
          g.colors[3 * to + c] = color_[3 * of + c];
        }
        std::copy_n(shape + 3, 4, &g.rotations[4 * to]);
        g.opacities[to] = opacity_[of];
        g.slots[to] = static_cast<std::uint32_t>(k * anchor + j);
        ++to;
      }
    }
  });
  return g;
}

template <class Real>
void AnchorDecoder<Real>::backward_block(const DecoderInputs<Real>& inputs, const NeuralGaussianGradients<Real>& given,
                                         const DecoderGradients<Real>& gradients, std::size_t begin, std::size_t end,
                                         std::span<Real> net_gradients) {
  const std::size_t rows = end - begin, k = shape_.offsets, width = shape_.features;
  Scratch& scratch = Scratch::of_this_thread();
  Real* opacity_gradient = Scratch::zeros(scratch.opacity_gradient, k * rows);
  Real* covariance_gradient = Scratch::zeros(scratch.covariance_gradient, 7 * k * rows);
  Real* color_gradient = Scratch::zeros(scratch.color_gradient, 3 * k * rows);
  for (std::size_t v = begin; v < end; ++v) {
    const std::size_t anchor = anchors_[v];
    const Real* size = &inputs.scales[6 * anchor];
    Real* log_scale_gradient = &gradients.log_scales[6 * anchor];
    std::size_t from = first_[v];
    for (std::size_t j = 0; j < k; ++j) {
      const std::size_t of = k * v + j, row = of - k * begin;
      if (!(opacity_[of] > 0)) continue;
      opacity_gradient[row] = tanh_gradient(given.opacities[from], opacity_[of]);
      const Real* offset = &inputs.offsets[3 * (k * anchor + j)];
      Real* offset_gradient = &gradients.offsets[3 * (k * anchor + j)];
      for (std::size_t c = 0; c < 3; ++c) {
        color_gradient[3 * row + c] = sigmoid_gradient(given.colors[3 * from + c], color_[3 * of + c]);
        const Real by_mean = given.means[3 * from + c] * size[c];
        offset_gradient[c] += by_mean;
        log_scale_gradient[c] += by_mean * offset[c];
        const Real scale = gaussians_.scales[3 * from + c];
        const Real by_log_scale = given.scales[3 * from + c] * scale;
        log_scale_gradient[3 + c] += by_log_scale;
        covariance_gradient[7 * row + c] = raw_scale_gradient(by_log_scale, scale, size[3 + c]);
      }
      std::copy_n(&given.rotations[4 * from], 4, &covariance_gradient[7 * row + 3]);
      ++from;
    }
  }

  Real* mixed = Scratch::room(scratch.mixed, rows * width);
  pack_features(inputs, begin, end, mixed);
  Real* mixed_gradient = Scratch::zeros(scratch.feature_gradient, rows * width);
  Real* hidden_gradient = Scratch::room(scratch.hidden_gradient, rows * width);
  std::span<Real> embedding_gradient = net_gradients.last(shape_.appearance);
  std::size_t at = 0;
  const auto part = [&](const NetShape& net) {
    at += net.parameters();
    return net_gradients.subspan(at - net.parameters(), net.parameters());
  };
  const auto run = [&](const NetShape& net, std::span<const Real> parameters, bool distance, bool appearance,
                       const std::vector<Real>& hidden, const Real* y_gradient) {
    Real* x = Scratch::room(scratch.x, rows * net.inputs);
    Real* x_gradient = Scratch::room(scratch.x_gradient, rows * net.inputs);
    pack_input(inputs, begin, end, mixed, distance, appearance, x);
    net_backward<Real>(net, parameters, rows, x, &hidden[width * begin], y_gradient, hidden_gradient, part(net),
                       x_gradient);
    for (std::size_t r = 0; r < rows; ++r) {
      const Real* row = x_gradient + r * net.inputs;
      for (std::size_t c = 0; c < width; ++c) mixed_gradient[r * width + c] += row[c];
      if (!appearance) continue;
      const Real* tail = row + net.inputs - shape_.appearance;
      for (std::size_t c = 0; c < shape_.appearance; ++c) embedding_gradient[c] += tail[c];
    }
  };
  run(shape_.opacity(), inputs.opacity_net, shape_.opacity_distance, false, opacity_hidden_, opacity_gradient);
  run(shape_.covariance(), inputs.covariance_net, shape_.covariance_distance, false, covariance_hidden_,
      covariance_gradient);
  run(shape_.color(), inputs.color_net, shape_.color_distance, true, color_hidden_, color_gradient);

  if (!shape_.feature_bank) {
    for (std::size_t v = begin; v < end; ++v) {
      Real* to = &gradients.features[width * anchors_[v]];
      for (std::size_t c = 0; c < width; ++c) to[c] += mixed_gradient[(v - begin) * width + c];
    }
    return;
  }
  Real* bank_gradient = Scratch::room(scratch.bank_gradient, 3 * rows);
  for (std::size_t v = begin; v < end; ++v) {
    const Real* f = &inputs.features[width * anchors_[v]];
    Real* to = &gradients.features[width * anchors_[v]];
    const Real* g = mixed_gradient + (v - begin) * width;
    const Real* w = &bank_[3 * v];
    Real by_weight[3] = {0, 0, 0};
    for (std::size_t c = 0; c < width; ++c) {
      const std::size_t coarse = coarse_channel(c, width), middle = middle_channel(c, width);
      to[coarse] += w[0] * g[c];
      to[middle] += w[1] * g[c];
      to[c] += w[2] * g[c];
      by_weight[0] += f[coarse] * g[c];
      by_weight[1] += f[middle] * g[c];
      by_weight[2] += f[c] * g[c];
    }
    const Real mean = w[0] * by_weight[0] + w[1] * by_weight[1] + w[2] * by_weight[2];
    for (std::size_t i = 0; i < 3; ++i) bank_gradient[3 * (v - begin) + i] = w[i] * (by_weight[i] - mean);
  }
  const NetShape net = shape_.bank();
  Real* x = Scratch::room(scratch.x, rows * net.inputs);
  Real* x_gradient = Scratch::room(scratch.x_gradient, rows * net.inputs);
  pack_bank_input(inputs, begin, end, x);
  net_backward<Real>(net, inputs.bank_net, rows, x, &bank_hidden_[width * begin], bank_gradient, hidden_gradient,
                     part(net), x_gradient);
}

template <class Real>
void AnchorDecoder<Real>::backward(const DecoderInputs<Real>& inputs, const NeuralGaussianGradients<Real>& given,
                                   const DecoderGradients<Real>& gradients) {
  const std::size_t count = anchors_.size(), all = all_net_parameters();
  const std::size_t blocks = (count + kBlock - 1) / kBlock;
  block_gradients_.resize(blocks * all);
  threads_.for_range(count, kBlock, [&](std::size_t begin, std::size_t end) {
    const std::span<Real> mine(&block_gradients_[begin / kBlock * all], all);
    std::fill(mine.begin(), mine.end(), Real(0));
    backward_block(inputs, given, gradients, begin, end, mine);
  });
  std::size_t at = 0;
  for (const std::span<Real> to : {gradients.opacity_net, gradients.covariance_net, gradients.color_net,
                                   shape_.feature_bank ? gradients.bank_net : std::span<Real>{}, gradients.embedding}) {
    threads_.for_range(to.size(), kGrain, [&](std::size_t begin, std::size_t end) {
      for (std::size_t b = 0; b < blocks; ++b) {
        const Real* from = &block_gradients_[b * all + at];
        for (std::size_t i = begin; i < end; ++i) to[i] += from[i];
      }
    });
    at += to.size();
  }
}

template class AnchorDecoder<float>;
template class AnchorDecoder<double>;

}  // namespace splatboost
