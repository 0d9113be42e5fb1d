// SPDX-License-Identifier: Apache-2.0
#include "program/command_line/suggest.h"

#include <algorithm>
#include <cstddef>

namespace splatboost::program {
namespace {

std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::vector<std::size_t>> cost(a.size() + 1, std::vector<std::size_t>(b.size() + 1));
  for (std::size_t i = 0; i <= a.size(); ++i) cost[i][0] = i;
  for (std::size_t j = 0; j <= b.size(); ++j) cost[0][j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t change = cost[i - 1][j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
      cost[i][j] = std::min({cost[i - 1][j] + 1, cost[i][j - 1] + 1, change});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
        cost[i][j] = std::min(cost[i][j], cost[i - 2][j - 2] + 1);
      }
    }
  }
  return cost[a.size()][b.size()];
}

}  // namespace

std::string nearest_name(std::string_view wrong, const std::vector<std::string>& names) {
  // The dashes in front of an option are no part of its name.
  std::size_t least = (wrong.size() - std::min(wrong.find_first_not_of('-'), wrong.size())) / 3 + 1;
  std::string nearest;
  for (const std::string& name : names) {
    // "iter" for "iterations" is an abbreviation rather than a typo.
    const bool abbreviates = wrong.size() >= 3 && std::string_view(name).substr(0, wrong.size()) == wrong;
    const std::size_t distance = abbreviates ? 1 : edit_distance(wrong, name);
    if (distance < least || (distance == least && nearest.empty())) {
      least = distance;
      nearest = name;
    }
  }
  return nearest;
}

std::string did_you_mean(std::string_view wrong, const std::vector<std::string>& names) {
  const std::string name = nearest_name(wrong, names);
  return name.empty() ? "" : "; did you mean " + name + "?";
}

}  // namespace splatboost::program
