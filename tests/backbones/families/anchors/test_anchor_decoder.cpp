// SPDX-License-Identifier: Apache-2.0
// Neural Gaussians: values against a direct implementation for one anchor, gradients of every input against finite
// differences in double for every combination of options, and the same bytes for any number of threads.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "support/decoder_models.h"

namespace splatboost {
namespace {

using testing::Model;
using testing::Options;

class Decoder : public ::testing::TestWithParam<Options> {};

TEST_P(Decoder, gradients_are_those_of_finite_differences) {
  constexpr std::size_t kAnchors = 6;
  Threads threads(1);
  Model<double> model(GetParam().shape, kAnchors);
  const std::vector<std::uint32_t> visible{0, 2, 3, 5};
  const std::array<double, 3> centre{0.3, -3.0, 0.8};
  AnchorDecoder<double> decoder(model.shape, threads);
  const RandomStream random(9, 0, RandomPurpose::net_parameters);
  const auto weight = [&](std::uint32_t slot, std::uint64_t column) { return random.normal(16 * slot + column); };

  // loss = Σ weight(slot, column)·number over the 14 numbers of each Gaussian. Weights depend on the slot alone, not on
  // the order of the Gaussians.
  const auto visit = [&](auto& g, auto&& use) {
    for (std::size_t i = 0; i < g.size(); ++i) {
      std::uint64_t column = 0;
      for (std::size_t c = 0; c < 3; ++c) use(g.slots[i], column++, g.means[3 * i + c]);
      for (std::size_t c = 0; c < 3; ++c) use(g.slots[i], column++, g.scales[3 * i + c]);
      for (std::size_t c = 0; c < 4; ++c) use(g.slots[i], column++, g.rotations[4 * i + c]);
      for (std::size_t c = 0; c < 3; ++c) use(g.slots[i], column++, g.colors[3 * i + c]);
      use(g.slots[i], column++, g.opacities[i]);
    }
  };
  std::size_t drawn = 0;
  const auto loss = [&] {
    model.activate();
    const NeuralGaussians<double>& g = decoder.forward(model.inputs(), visible, centre);
    double sum = 0;
    visit(g, [&](std::uint32_t slot, std::uint64_t column, double value) { sum += weight(slot, column) * value; });
    drawn = g.size();
    return sum;
  };

  loss();
  const std::size_t gaussians = drawn;
  ASSERT_GT(gaussians, 2u);
  ASSERT_LT(gaussians, visible.size() * model.shape.offsets) << "some opacities must be below 0 to test the mask";
  NeuralGaussians<double> given = decoder.forward(model.inputs(), visible, centre);
  visit(given, [&](std::uint32_t slot, std::uint64_t column, double& value) { value = weight(slot, column); });
  Model<double> g = model;
  for (auto* values : {&g.offsets, &g.features, &g.log_scales, &g.opacity_net, &g.covariance_net, &g.color_net,
                       &g.bank_net, &g.embedding}) {
    std::fill(values->begin(), values->end(), 0.5);  // gradients accumulate
  }
  decoder.backward(
      model.inputs(), {given.means, given.scales, given.rotations, given.opacities, given.colors},
      {g.offsets, g.features, g.log_scales, g.opacity_net, g.covariance_net, g.color_net, g.bank_net, g.embedding});

  constexpr double kStep = 1e-6;
  const auto check = [&](const char* name, std::vector<double>& values, const std::vector<double>& gradients) {
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double was = values[i];
      values[i] = was + kStep;
      const double above = loss();
      ASSERT_EQ(drawn, gaussians);
      values[i] = was - kStep;
      const double below = loss();
      ASSERT_EQ(drawn, gaussians);
      values[i] = was;
      EXPECT_NEAR(gradients[i] - 0.5, (above - below) / (2 * kStep), 2e-7) << name << " " << i;
    }
  };
  check("offsets", model.offsets, g.offsets);
  check("features", model.features, g.features);
  check("log_scales", model.log_scales, g.log_scales);
  check("opacity_net", model.opacity_net, g.opacity_net);
  check("covariance_net", model.covariance_net, g.covariance_net);
  check("color_net", model.color_net, g.color_net);
  check("bank_net", model.bank_net, g.bank_net);
  check("embedding", model.embedding, g.embedding);
}

TEST_P(Decoder, gives_the_same_bytes_for_any_number_of_threads) {
  constexpr std::size_t kAnchors = 1100;  // several blocks, the last of them partial
  const Model<float> model(GetParam().shape, kAnchors);
  std::vector<std::uint32_t> visible;
  for (std::uint32_t i = 0; i < kAnchors; i += 1 + i % 2) visible.push_back(i);
  std::vector<std::vector<float>> results[2];
  for (const int count : {1, 3}) {
    Threads threads(count);
    AnchorDecoder<float> decoder(model.shape, threads);
    const NeuralGaussians<float> g = decoder.forward(model.inputs(), visible, {0, -3, 1});
    Model<float> to = model;
    decoder.backward(model.inputs(), {g.means, g.scales, g.rotations, g.opacities, g.colors},
                     {to.offsets, to.features, to.log_scales, to.opacity_net, to.covariance_net, to.color_net,
                      to.bank_net, to.embedding});
    results[count / 2] = {g.means,      g.scales,    g.rotations,   g.opacities,    g.colors,
                          to.offsets,   to.features, to.log_scales, to.opacity_net, to.covariance_net,
                          to.color_net, to.bank_net, to.embedding};
  }
  EXPECT_EQ(results[0], results[1]);
}

INSTANTIATE_TEST_SUITE_P(Options, Decoder, ::testing::ValuesIn(testing::all_options()),
                         [](const auto& test) { return std::string(test.param.name); });

TEST(AnchorDecoder, one_anchor_by_hand) {
  // Nets with zero weights: every anchor's Gaussians are given by the biases.
  Threads threads(1);
  DecoderShape shape;
  shape.features = 4;
  shape.offsets = 2;
  Model<double> model(shape, 1);
  for (auto* net : {&model.opacity_net, &model.covariance_net, &model.color_net})
    std::fill(net->begin(), net->end(), 0);
  const auto bias = [](std::vector<double>& net, std::initializer_list<double> values) {
    std::copy(values.begin(), values.end(), net.end() - static_cast<std::ptrdiff_t>(values.size()));
  };
  bias(model.opacity_net, {-1.0, 0.5});  // the first slot is not drawn
  bias(model.covariance_net, {9, 9, 9, 9, 9, 9, 9, 0.0, 1.0, -1.0, 0.2, 0.3, 0.4, 0.5});
  bias(model.color_net, {9, 9, 9, 0.0, 2.0, -2.0});
  model.positions = {1, 2, 3};
  model.offsets = {9, 9, 9, 0.5, -1, 2};
  model.scales = {0.1, 0.2, 0.3, 1, 2, 4};
  AnchorDecoder<double> decoder(shape, threads);
  const std::vector<std::uint32_t> visible{0};
  const NeuralGaussians<double>& g = decoder.forward(model.inputs(), visible, {0, 0, 0});
  ASSERT_EQ(g.slots, (std::vector<std::uint32_t>{1}));
  const auto logistic = [](double x) { return 1 / (1 + std::exp(-x)); };
  const auto expect = [](const std::vector<double>& values, std::initializer_list<double> expected) {
    ASSERT_EQ(values.size(), expected.size());
    std::size_t i = 0;
    for (const double value : expected) EXPECT_NEAR(values[i++], value, 1e-12);
  };
  expect(g.opacities, {std::tanh(0.5)});
  expect(g.means, {1.05, 1.8, 3.6});
  expect(g.scales, {0.5, 2 * logistic(1), 4 * logistic(-1)});
  expect(g.rotations, {0.2, 0.3, 0.4, 0.5});
  expect(g.colors, {0.5, logistic(2), logistic(-2)});
}

TEST(AnchorDecoder, no_anchor_in_view_is_no_gaussian) {
  Threads threads(2);
  Model<float> model(testing::small_shape(), 3);
  AnchorDecoder<float> decoder(model.shape, threads);
  EXPECT_EQ(decoder.forward(model.inputs(), {}, {0, 0, 0}).size(), 0u);
  Model<float> to = model;
  decoder.backward(model.inputs(), {},
                   {to.offsets, to.features, to.log_scales, to.opacity_net, to.covariance_net, to.color_net,
                    to.bank_net, to.embedding});
  EXPECT_EQ(to.opacity_net, model.opacity_net);
}

}  // namespace
}  // namespace splatboost
