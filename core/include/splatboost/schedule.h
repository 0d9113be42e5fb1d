// SPDX-License-Identifier: Apache-2.0
/// @file When things happen in a run of any length: the paper's 30 000-iteration plan, in proportion.
#pragma once

namespace splatboost {

/// Length of the published run; iteration numbers of the papers refer to it.
inline constexpr int kPublishedIterations = 30000;

/// A moment of a run. Iterations count from 1 to total.
struct Moment {
  int iteration = 0;
  int total = kPublishedIterations;
};

/// The iteration of a run of `total` that corresponds to `published` of a run of `published_total`, at least 1.
int scaled_iteration(int published, int total, int published_total = kPublishedIterations);

/// How often a parameter group steps in each of three phases of the run; gradients accumulate in between. All are of
/// the published run: the ends of the phases scale with a run's length, the intervals with its cube, because a short
/// run has made few steps when a phase begins; never above the published interval.
struct StepIntervals {
  int early = 1;   ///< until early_end
  int middle = 1;  ///< until middle_end
  int late = 1;    ///< after it
  int early_end = 15000;
  int middle_end = 20000;
};

/// Whether a group of these intervals steps at this moment. The last iteration of a run always steps.
/// @param published_total length of the published run that the ends of the phases are of
bool steps_at(const StepIntervals& intervals, Moment moment, int published_total = kPublishedIterations);

/// The same with the intervals as they are, in a run of any length; only the ends of the phases scale.
bool steps_literally_at(const StepIntervals& intervals, Moment moment, int published_total = kPublishedIterations);

/// Log-linear interpolation from `initial` at iteration 0 to `final_value` at `steps` and after.
double exponential_rate(double initial, double final_value, int iteration, int steps);

}  // namespace splatboost
