// SPDX-License-Identifier: Apache-2.0
#include "splatboost/schedule.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "splatboost/errors.h"

namespace splatboost {

int scaled_iteration(int published, int total, int published_total) {
  SPLATBOOST_CHECK(published >= 0 && total > 0 && published_total > 0,
                   "iterations must not be negative, and a run must not be empty");
  const double scaled = static_cast<double>(published) * total / published_total;
  return static_cast<int>(std::clamp(std::round(scaled), 1.0, static_cast<double>(std::numeric_limits<int>::max())));
}

namespace {

/// The published interval of the phase that contains the moment.
int interval_at(const StepIntervals& intervals, Moment moment, int published_total) {
  const auto ended = [&](int end) { return moment.iteration > scaled_iteration(end, moment.total, published_total); };
  if (!ended(intervals.early_end)) return intervals.early;
  if (!ended(intervals.middle_end)) return intervals.middle;
  return intervals.late;
}

}  // namespace

int step_interval(const StepIntervals& intervals, Moment moment, int published_total) {
  // Proportional to the cube of the length: a short run has made few steps when a phase begins and cannot skip any.
  const double length = std::min(1.0, static_cast<double>(moment.total) / kPublishedIterations);
  const int published = interval_at(intervals, moment, published_total);
  return static_cast<int>(std::max(1L, std::lround(published * length * length * length)));
}

bool steps_at(const StepIntervals& intervals, Moment moment, int published_total) {
  return moment.iteration >= moment.total || moment.iteration % step_interval(intervals, moment, published_total) == 0;
}

bool steps_literally_at(const StepIntervals& intervals, Moment moment, int published_total) {
  return moment.iteration >= moment.total ||
         moment.iteration % std::max(1, interval_at(intervals, moment, published_total)) == 0;
}

bool averages_at(double share, Moment moment) {
  constexpr int kMost = 64;  // more would cost time and change little: successive parameters differ little
  const int averaged = static_cast<int>(share * moment.total), left = moment.total - moment.iteration;
  return left >= 0 && left < averaged && left % ((averaged + kMost - 1) / kMost) == 0;
}

double exponential_rate(double initial, double final_value, int iteration, int steps) {
  SPLATBOOST_CHECK(initial > 0 && final_value > 0 && steps > 0, "rates and steps must be above 0");
  const double t = std::clamp(static_cast<double>(iteration) / steps, 0.0, 1.0);
  return std::exp(std::log(initial) * (1 - t) + std::log(final_value) * t);
}

}  // namespace splatboost
