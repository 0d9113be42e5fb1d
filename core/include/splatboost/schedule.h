// SPDX-License-Identifier: Apache-2.0
/// @file Schedules for runs of any length, scaled from the 30 000 iterations of the paper.
#pragma once

namespace splatboost {

/// Length of the published run; iteration numbers of the papers refer to it.
inline constexpr int kPublishedIterations = 30000;

/// A point in a run. Iterations count from 1 to total.
struct Moment {
  int iteration = 0;
  int total = kPublishedIterations;
};

/// The iteration of a run of `total` that corresponds to `published` of a run of `published_total`, at least 1.
/// Throws ArgumentError if `published` is negative or a length is not above 0.
int scaled_iteration(int published, int total, int published_total = kPublishedIterations);

/// How often a parameter group steps in each of three phases of the run; gradients accumulate in between. Values are
/// for the published run. The ends of the phases scale with a run's length, the intervals with its cube, because a
/// short run has made few steps when a phase begins; intervals never exceed the published ones. Those below 1 count as
/// 1.
struct StepIntervals {
  int early = 1;   ///< until early_end
  int middle = 1;  ///< until middle_end
  int late = 1;    ///< after it
  int early_end = 15000;
  int middle_end = 20000;
};

/// The interval of the phase that contains the moment, scaled, at least 1.
/// @param published_total length of the published run that early_end and middle_end refer to
int step_interval(const StepIntervals& intervals, Moment moment, int published_total = kPublishedIterations);

/// Whether a group with these intervals steps at this iteration. Every group steps at the last iteration of a run.
bool steps_at(const StepIntervals& intervals, Moment moment, int published_total = kPublishedIterations);

/// The same without scaling the intervals; only the ends of the phases scale.
bool steps_literally_at(const StepIntervals& intervals, Moment moment, int published_total = kPublishedIterations);

/// Whether the parameters of this iteration are among those that are averaged at the end of a run (Polyak and Juditsky
/// 1992): up to 64, evenly spaced in the last `share` of the run, the last one at its last iteration.
bool averages_at(double share, Moment moment);

/// Log-linear interpolation from `initial` at iteration 0 to `final_value` at `steps` and after. Throws ArgumentError
/// unless both rates and `steps` are above 0.
double exponential_rate(double initial, double final_value, int iteration, int steps);

}  // namespace splatboost
