// SPDX-License-Identifier: Apache-2.0
// The deep net: values against plain loops, gradients against finite differences in double, rows without a gradient,
// any number of threads. And the encoding of its inputs.
#include "families/nets/deep_net.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "families/nets/frequency_encoding.h"

namespace splatboost {
namespace {

constexpr DeepNetShape kShape{5, 3, 7, 4, 2, 6};
constexpr std::size_t kRows = 11;

template <class Real>
std::vector<Real> random_values(std::size_t n, std::uint64_t seed, double scale = 1) {
  const RandomStream random(seed, 0, RandomPurpose::net_parameters);
  std::vector<Real> values(n);
  for (std::size_t i = 0; i < n; ++i) values[i] = static_cast<Real>(scale * random.normal(i));
  return values;
}

/// Output of one row by the definition. A layer's inputs are ordered: the row's, the shared ones, the previous layer's.
std::vector<double> plain_row(const DeepNetShape& shape, const std::vector<double>& p, std::vector<double> x,
                              const std::vector<double>& shared) {
  std::vector<double> h;
  std::size_t at = 0;
  const auto layer = [&](std::size_t outputs, std::initializer_list<const std::vector<double>*> inputs) {
    std::vector<double> sums(outputs, 0.0);
    for (const std::vector<double>* input : inputs) {
      for (double& sum : sums) {
        for (const double value : *input) sum += p[at++] * value;
      }
    }
    for (double& sum : sums) sum += p[at++];
    return sums;
  };
  for (std::size_t l = 0; l < shape.layers; ++l) {
    if (l == 0) {
      h = layer(shape.hidden, {&x, &shared});
    } else if (l == shape.joined) {
      h = layer(shape.hidden, {&x, &shared, &h});
    } else {
      h = layer(shape.hidden, {&h});
    }
    for (double& value : h) value = std::max(value, 0.0);
  }
  const std::vector<double> y = layer(shape.outputs, {&h});
  EXPECT_EQ(at, p.size());
  return y;
}

/// Runs a net on rows [rows,inputs].
template <class Real>
struct NetRun {
  NetRun(const DeepNetShape& of, const Threads& threads, std::vector<Real> with, std::vector<Real> in,
         std::vector<Real> common)
      : shape(of), net(of, threads), p(std::move(with)), x(std::move(in)), shared(std::move(common)) {}
  std::vector<Real> forward(bool keep = true) {
    const std::size_t rows = x.size() / shape.inputs;
    std::vector<Real> y(rows * shape.outputs);
    net.forward(
        p, shared, rows,
        [&](std::size_t begin, std::size_t end, Real* to) {
          std::copy_n(x.data() + begin * shape.inputs, (end - begin) * shape.inputs, to);
        },
        y, keep);
    return y;
  }
  DeepNetShape shape;
  DeepNet<Real> net;
  std::vector<Real> p, x, shared;
};

NetRun<double> small_run(const Threads& threads, const DeepNetShape& shape = kShape) {
  return {shape, threads, random_values<double>(shape.parameters(), 1, 0.6),
          random_values<double>(kRows * shape.inputs, 2), random_values<double>(shape.shared, 3)};
}

TEST(DeepNet, values_are_those_of_the_definition) {
  Threads threads(2);
  for (const DeepNetShape& shape : {kShape, DeepNetShape{5, 3, 7, 3, 0, 6}, DeepNetShape{2, 1, 4, 1, 0, 1}}) {
    NetRun<double> run = small_run(threads, shape);
    for (const bool keep : {true, false}) {
      const std::vector<double> y = run.forward(keep);
      for (std::size_t r = 0; r < kRows; ++r) {
        const auto row = run.x.begin() + static_cast<std::ptrdiff_t>(r * shape.inputs);
        const std::vector<double> expected =
            plain_row(shape, run.p, {row, row + static_cast<std::ptrdiff_t>(shape.inputs)}, run.shared);
        for (std::size_t o = 0; o < shape.outputs; ++o) ASSERT_NEAR(y[r * shape.outputs + o], expected[o], 1e-12);
      }
    }
  }
}

TEST(DeepNet, gradients_are_those_of_finite_differences) {
  Threads threads(2);
  NetRun<double> run = small_run(threads);
  std::vector<double> weights = random_values<double>(kRows * kShape.outputs, 5);  // loss = Σ weights·y
  std::fill_n(weights.begin() + 3 * kShape.outputs, 2 * kShape.outputs, 0.0);      // two rows without a gradient
  const auto loss = [&] {
    const std::vector<double> y = run.forward();
    double sum = 0;
    for (std::size_t i = 0; i < y.size(); ++i) sum += weights[i] * y[i];
    return sum;
  };
  std::vector<double> of_p(run.p.size(), 1.0), of_shared(run.shared.size(), 9.0);  // of_p accumulates
  run.forward();
  run.net.backward(run.p, run.shared, weights, of_p, of_shared);
  constexpr double kStep = 1e-6;
  const auto slope = [&](double& value) {
    const double was = value;
    value = was + kStep;
    const double above = loss();
    value = was - kStep;
    const double below = loss();
    value = was;
    return (above - below) / (2 * kStep);
  };
  for (std::size_t i = 0; i < run.p.size(); ++i) ASSERT_NEAR(of_p[i] - 1.0, slope(run.p[i]), 2e-8) << "parameter " << i;
  for (std::size_t i = 0; i < run.shared.size(); ++i) ASSERT_NEAR(of_shared[i], slope(run.shared[i]), 2e-8) << i;
}

TEST(DeepNet, floats_are_the_same_for_any_threads_and_close_to_doubles) {
  constexpr DeepNetShape kWide{9, 5, 32, 4, 3, 7};
  constexpr std::size_t kMany = 1500;  // processed in several chunks
  const auto p = random_values<float>(kWide.parameters(), 1, 0.15), x = random_values<float>(kMany * kWide.inputs, 2),
             shared = random_values<float>(kWide.shared, 3), dy = random_values<float>(kMany * kWide.outputs, 4);
  std::vector<std::vector<float>> outcomes;
  for (const int count : {1, 3}) {
    Threads threads(count);
    NetRun<float> run(kWide, threads, p, x, shared);
    std::vector<float> of_p(p.size()), of_shared(shared.size());
    std::vector<float> all = run.forward(false);
    EXPECT_EQ(run.forward(true), all);
    run.net.backward(p, shared, dy, of_p, of_shared);
    all.insert(all.end(), of_p.begin(), of_p.end());
    all.insert(all.end(), of_shared.begin(), of_shared.end());
    outcomes.push_back(all);
  }
  EXPECT_EQ(outcomes[0], outcomes[1]);

  Threads threads(1);
  NetRun<double> exact(kWide, threads, {p.begin(), p.end()}, {x.begin(), x.end()}, {shared.begin(), shared.end()});
  std::vector<double> of_p(p.size()), of_shared(shared.size()), all = exact.forward();
  exact.net.backward(exact.p, exact.shared, std::vector<double>(dy.begin(), dy.end()), of_p, of_shared);
  all.insert(all.end(), of_p.begin(), of_p.end());
  all.insert(all.end(), of_shared.begin(), of_shared.end());
  for (std::size_t i = 0; i < all.size(); ++i) {
    ASSERT_NEAR(static_cast<double>(outcomes[0][i]), all[i], 2e-4 * (1 + std::abs(all[i]))) << i;
  }
}

TEST(DeepNet, parameters_start_within_the_layers_bounds) {
  const DeepNetShape shape{63, 30, 256, 8, 5, 10};
  EXPECT_EQ(shape.parameters(), 256u * (93 + 1) + 6u * 256 * 257 + 256u * (93 + 256 + 1) + 10u * 257);
  const std::vector<float> p = initial_deep_net_parameters(shape, RandomStream(0, 0, RandomPurpose::net_parameters), 0);
  ASSERT_EQ(p.size(), shape.parameters());
  for (const auto& [layer, inputs] : {std::pair{0u, 93.0}, {1u, 256.0}, {5u, 349.0}, {8u, 256.0}}) {
    float most = 0;
    for (std::size_t i = shape.begin(layer); i < shape.begin(layer + 1); ++i) most = std::max(most, std::abs(p[i]));
    EXPECT_LE(most, 1 / std::sqrt(inputs)) << layer;
    EXPECT_GT(most, 0.99 / std::sqrt(inputs)) << layer;
  }
}

TEST(FrequencyEncoding, is_that_of_the_library) {
  constexpr std::size_t kFrequencies = 10, kWidth = encoded_width(3, kFrequencies);
  std::vector<float> x = random_values<float>(30, 6, 3);
  x.insert(x.end(), {0.0f, -1e5f, 1e6f});
  const std::size_t rows = x.size() / 3;
  std::vector<float> found(rows * kWidth);
  encode_positions(rows, kFrequencies, x.data(), found.data());
  for (std::size_t r = 0; r < rows; ++r) {
    for (std::size_t c = 0; c < 3; ++c) {
      const double value = static_cast<double>(x[3 * r + c]);
      std::vector<float> alone(encoded_width(1, kFrequencies));
      encode_number(x[3 * r + c], std::span(alone));
      EXPECT_EQ(found[r * kWidth + c], x[3 * r + c]);
      for (std::size_t k = 0; k < kFrequencies; ++k) {
        const double angle = std::ldexp(value, static_cast<int>(k));
        EXPECT_NEAR(static_cast<double>(found[r * kWidth + 3 + 6 * k + c]), std::sin(angle), 3e-7) << angle;
        EXPECT_NEAR(static_cast<double>(found[r * kWidth + 6 + 6 * k + c]), std::cos(angle), 3e-7) << angle;
        EXPECT_NEAR(static_cast<double>(alone[1 + 2 * k]), std::sin(angle), 3e-7);
        EXPECT_NEAR(static_cast<double>(alone[2 + 2 * k]), std::cos(angle), 3e-7);
      }
    }
  }
}

}  // namespace
}  // namespace splatboost
