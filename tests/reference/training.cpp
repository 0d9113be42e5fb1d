// SPDX-License-Identifier: Apache-2.0
#include "reference/training.h"

#include <algorithm>
#include <cmath>

namespace splatboost::reference {

void adam_step(AdamState& state, const std::vector<double>& gradients, std::int64_t step, double learning_rate,
               double beta1, double beta2, double epsilon) {
  const double correction1 = 1 - std::pow(beta1, static_cast<double>(step));
  const double correction2 = 1 - std::pow(beta2, static_cast<double>(step));
  for (std::size_t i = 0; i < gradients.size(); ++i) {
    state.first[i] = beta1 * state.first[i] + (1 - beta1) * gradients[i];
    state.second[i] = beta2 * state.second[i] + (1 - beta2) * gradients[i] * gradients[i];
    const double mean = state.first[i] / correction1;
    const double deviation = std::sqrt(state.second[i] / correction2);
    state.values[i] -= learning_rate * mean / (deviation + epsilon);
  }
}

std::vector<double> mean_squared_neighbor_distances(const std::vector<double>& points, int k) {
  const std::size_t count = points.size() / 3;
  std::vector<double> result(count, 0);
  for (std::size_t i = 0; i < count; ++i) {
    std::vector<double> squares;
    for (std::size_t j = 0; j < count; ++j) {
      if (j == i) continue;
      double square = 0;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double difference = points[3 * i + axis] - points[3 * j + axis];
        square += difference * difference;
      }
      squares.push_back(square);
    }
    std::sort(squares.begin(), squares.end());
    const std::size_t used = std::min(squares.size(), static_cast<std::size_t>(k));
    for (std::size_t n = 0; n < used; ++n) result[i] += squares[n] / static_cast<double>(used);
  }
  return result;
}

namespace {

void draw(const std::vector<double>& weights, std::size_t left, double probability, std::vector<bool>& drawn,
          std::vector<double>& inclusion) {
  if (left == 0) return;
  double total = 0;
  for (std::size_t i = 0; i < weights.size(); ++i) total += drawn[i] ? 0 : weights[i];
  for (std::size_t i = 0; i < weights.size(); ++i) {
    if (drawn[i]) continue;
    const double chance = probability * weights[i] / total;
    inclusion[i] += chance;
    drawn[i] = true;
    draw(weights, left - 1, chance, drawn, inclusion);
    drawn[i] = false;
  }
}

}  // namespace

std::vector<double> inclusion_probabilities(const std::vector<double>& weights, std::size_t keep) {
  std::vector<double> inclusion(weights.size(), 0);
  std::vector<bool> drawn(weights.size(), false);
  draw(weights, keep, 1, drawn, inclusion);
  return inclusion;
}

}  // namespace splatboost::reference
