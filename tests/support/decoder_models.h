// SPDX-License-Identifier: Apache-2.0
/// @file Anchors with networks of random parameters, for every combination of a decoder's options.
#pragma once

#include <cmath>
#include <cstdint>
#include <ostream>
#include <span>
#include <vector>

#include "families/anchors/anchor_decoder.h"
#include "splatboost/random.h"

namespace splatboost::testing {

/// Everything that a decoder reads, for N anchors.
template <class Real>
struct Model {
  DecoderShape shape;
  std::vector<Real> positions, offsets, features, log_scales, scales, levels, opacity_net, covariance_net, color_net,
      bank_net, embedding;

  Model(const DecoderShape& s, std::size_t n) : shape(s) {
    const RandomStream random(5, 0, RandomPurpose::net_parameters);
    std::uint64_t next = 0;
    const auto fill = [&](std::vector<Real>& values, std::size_t count, double spread, double middle = 0) {
      for (std::size_t i = 0; i < count; ++i) {
        values.push_back(static_cast<Real>(middle + spread * random.normal(next++)));
      }
    };
    fill(positions, 3 * n, 1);
    fill(offsets, 3 * n * s.offsets, 0.5);
    fill(features, n * s.features, 1);
    fill(log_scales, 6 * n, 0.3, -1);
    for (std::size_t i = 0; i < n; ++i) levels.push_back(static_cast<Real>(i % 4));
    fill(opacity_net, s.opacity().parameters(), 0.4);
    fill(covariance_net, s.covariance().parameters(), 0.4);
    fill(color_net, s.color().parameters(), 0.4);
    if (s.feature_bank) fill(bank_net, s.bank().parameters(), 0.4);
    fill(embedding, s.appearance, 1);
    activate();
  }
  void activate() {
    scales.clear();
    for (const Real value : log_scales) scales.push_back(std::exp(value));
  }
  DecoderInputs<Real> inputs() const {
    return {positions,
            offsets,
            features,
            scales,
            shape.level ? std::span<const Real>(levels) : std::span<const Real>{},
            opacity_net,
            covariance_net,
            color_net,
            bank_net,
            embedding};
  }
};

struct Options {
  const char* name;
  DecoderShape shape;
  friend std::ostream& operator<<(std::ostream& out, const Options& options) { return out << options.name; }
};

inline DecoderShape small_shape() {
  DecoderShape shape;
  shape.features = 8;
  shape.offsets = 3;
  return shape;
}

inline std::vector<Options> all_options() {
  std::vector<Options> all{{"plain", small_shape()}};
  const auto add = [&](const char* name, auto&& change) {
    DecoderShape shape = small_shape();
    change(shape);
    all.push_back({name, shape});
  };
  add("distances", [](DecoderShape& s) { s.opacity_distance = s.covariance_distance = s.color_distance = true; });
  add("one_distance", [](DecoderShape& s) { s.covariance_distance = true; });
  add("appearance", [](DecoderShape& s) { s.appearance = 5; });
  add("bank", [](DecoderShape& s) { s.feature_bank = true; });
  add("levels", [](DecoderShape& s) { s.level = true; });
  add("all", [](DecoderShape& s) {
    s.opacity_distance = s.covariance_distance = s.color_distance = s.level = s.feature_bank = true;
    s.bank_distance = false;
    s.appearance = 4;
  });
  return all;
}

}  // namespace splatboost::testing
