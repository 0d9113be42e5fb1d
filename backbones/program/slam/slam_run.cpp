// SPDX-License-Identifier: Apache-2.0
#include "program/slam/slam_run.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <stdexcept>
#include <thread>
#include <utility>

#include "splatboost/errors.h"
#include "trainer/dataset/view_image.h"
#include "trainer/images/image_codec.h"
#include "trainer/support/input_error.h"
#include "trainer/support/text.h"
#include "trainer/training/progress.h"

namespace splatboost::program {
namespace {

constexpr double kLossWeight = 0.05;     ///< weight of the newest loss in the shown mean
constexpr double kShownEvery = 2;        ///< s
constexpr std::size_t kMaxProblems = 5;  ///< most messages about single frames
constexpr float kMinExtent = 0.1f;       ///< metres, for a camera that only turns
constexpr int kCurvePoints = 40;
constexpr std::size_t kCheckedKeyframes = 6;  ///< keyframes after which the calibration is checked
constexpr int kPlannedIterations = 100;       ///< iterations between predictions of their number
constexpr auto kIdle = std::chrono::milliseconds(2);

double now() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

}  // namespace

View view_of(const SequenceFrame& frame, const Calibration& calibration, int resolution,
             const glm::dmat4& camera_from_world) {
  const ImageSize size = target_size(frame.width, frame.height, resolution);
  Pixels pixels{frame.width, frame.height, 3, 8, frame.color};
  const bool smaller = size.width != frame.width || size.height != frame.height;
  if (smaller) pixels = shrink_image(pixels, size.width, size.height, frame.name);
  View view;
  view.name = frame.name;
  const double across = static_cast<double>(size.width) / frame.width;
  const double down = static_cast<double>(size.height) / frame.height;
  // From here on, the centre of the first pixel is at (0.5, 0.5).
  view.camera.width = size.width;
  view.camera.height = size.height;
  view.camera.fx = static_cast<float>(calibration.fx * across);
  view.camera.fy = static_cast<float>(calibration.fy * down);
  view.camera.cx = static_cast<float>((calibration.cx + 0.5) * across);
  view.camera.cy = static_cast<float>((calibration.cy + 0.5) * down);
  view.camera.camera_from_world = glm::mat4(camera_from_world);
  const auto width = static_cast<std::size_t>(size.width), height = static_cast<std::size_t>(size.height);
  const std::size_t count = width * height;
  view.color.resize(3 * count);
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t c = 0; c < 3; ++c) view.color[c * count + i] = pixels.bytes[3 * i + c];
  }
  view.valid = frame.valid;
  if (smaller && !frame.valid.empty()) {
    const Pixels valid{frame.width, frame.height, 1, 8, frame.valid};
    view.valid = shrink_mask(valid, size.width, size.height, frame.name).bytes;
  }
  return view;
}

SlamRun::SlamRun(Sequence& sequence, const SlamOptions& slam, const RunOptions& options,
                 std::function<PluggedBackbone(const Scene&)> make_backbone, std::function<bool()> stopped)
    : sequence_(sequence),
      slam_(slam),
      options_(options),
      make_backbone_(std::move(make_backbone)),
      stopped_(std::move(stopped)),
      tracker_(sequence.calibration(), slam.tracker) {
  scene_.white_background = options.scene.white_background;
}

double SlamRun::seconds() const { return now() - began_; }

void SlamRun::tell(const TrackedFrame& frame, const SequenceFrame& picture) {
  const auto say = [&](const std::string& what) {
    std::fprintf(stderr, "frame %zu (%s): %s\n", frame.frame, printable(picture.name).c_str(), printable(what).c_str());
  };
  unusable_ += picture.color.empty() ? 1 : 0;
  if (!picture.problem.empty() && ++problems_ <= kMaxProblems) {
    const char* const so = picture.color.empty()                ? "; left out"
                           : frame.state == TrackState::tracked ? "; tracked by colour alone"
                           : frame.state == TrackState::waiting ? "; left out, because a map begins with depth"
                                                                : "; not tracked";
    say(picture.problem + so + (problems_ == kMaxProblems ? " (further messages of this kind are not printed)" : ""));
  }
  if (frame.state == TrackState::lost && last_state_ != TrackState::lost) {
    say("tracking lost: too little of the map is visible; trying to relocalize at each of the next frames");
  }
  if (frame.begins_anew) say("the map was dropped, because it was lost soon after it had begun; another one begins");
  if (frame.relocalized) say("tracking resumed: the camera was relocalized in the map");
  if (frame.closed_loop && !options_.quiet) say("a loop was closed: poses and Gaussians were corrected");
  if (frame.state != TrackState::dropped) last_state_ = frame.state;
}

void SlamRun::check_focal_lengths() const {
  if (sequence_.computes_depth()) return;
  const std::optional<double> factor = tracker_.better_focal_factor();
  if (!factor) return;
  const Calibration& c = sequence_.calibration();
  std::fprintf(
      stderr,
      "warning: pictures and depth fit focal lengths of about %.0f and %.0f px better than the %.0f and %.0f of "
      "the calibration; check fx, fy and the image size that they belong to\n",
      *factor * c.fx, *factor * c.fy, c.fx, c.fy);
}

std::optional<SlamRun::Update> SlamRun::track(std::size_t number) {
  const double start = now();
  SequenceFrame frame = sequence_.read(number);
  const TrackedFrame tracked = tracker_.track(frame);
  if (tracked.begins_anew) forget_map();
  tracked_ += tracked.state == TrackState::tracked ? 1 : 0;
  outcome_.frames.push_back(tracked);
  tell(tracked, frame);
  std::optional<Update> update;
  if (tracked.is_keyframe) {
    const std::size_t keyframe = tracker_.keyframes() - 1;
    for (std::size_t i = outcome_.keyframe_frames.size(); i <= keyframe; ++i) {
      const std::size_t of = tracker_.frame_of(i);
      if (of != number) {  // without depth the map begins with two keyframes: this frame and an earlier one
        outcome_.frames[of].state = TrackState::tracked;
        outcome_.frames[of].keyframe = i;
        outcome_.frames[of].is_keyframe = true;
        ++tracked_;
      }
      const SequenceFrame picture = of == number ? frame : sequence_.read(of);
      require(!picture.color.empty(), picture.problem);
      held_.push_back(view_of(picture, sequence_.calibration(), options_.scene.resolution.value_or(-1),
                              tracker_.camera_from_world(i)));
      outcome_.keyframe_frames.push_back(of);
    }
    if (outcome_.keyframe_frames.size() == kCheckedKeyframes) check_focal_lengths();
    if (!tracker_.on_trial()) update = next_update();
  }
  outcome_.tracking_seconds += now() - start;
  return update;
}

SlamRun::Update SlamRun::next_update() {
  Update update;
  update.views = std::exchange(held_, {});
  for (std::size_t i = 0; i < tracker_.keyframes(); ++i) update.poses.push_back(tracker_.camera_from_world(i));
  update.change = tracker_.take_change();
  return update;
}

void SlamRun::take_held() {
  if (!take_failed_ && !held_.empty()) take(next_update());
}

void SlamRun::forget_map() {
  for (TrackedFrame& frame : outcome_.frames) {
    if (frame.state == TrackState::tracked) frame.state = TrackState::waiting;
    frame.is_keyframe = false;
  }
  tracked_ = 0;
  outcome_.keyframe_frames.clear();
  held_.clear();
}

bool SlamRun::may_begin_mapping() const { return slam_.keep_untrained || (outcome_.failure == nullptr && !stopped_()); }

void SlamRun::begin_mapping() {
  scene_.points = first_points_.points;  // a copy, because making the backbone may run out of memory
  scene_.extent = std::max(camera_extent(scene_.train), kMinExtent);
  plugged_ = make_backbone_(scene_);
  online_ = dynamic_cast<OnlineBackbone*>(plugged_.backbone.get());
  SPLATBOOST_CHECK(online_ != nullptr, "the backbone must support online training");
  online_->map_changed({});
  first_points_ = {};
}

void SlamRun::take(Update update) {
  try {
    add_to_map(std::move(update));
  } catch (...) {
    take_failed_ = true;
    throw;
  }
}

void SlamRun::add_to_map(Update update) {
  for (View& view : update.views) scene_.train.push_back(std::move(view));
  for (std::size_t i = 0; i < scene_.train.size(); ++i) {
    scene_.train[i].camera.camera_from_world = glm::mat4(update.poses[i]);
  }
  if (online_ != nullptr) {
    sample_curve();
    return online_->map_changed(update.change);
  }
  // The first keyframes, whose points initialize the map. Reserve first, so that a failure leaves the points intact.
  const SeenPoints& more = update.change.map_points;
  std::vector<float>& positions = first_points_.points.positions;
  positions.reserve(positions.size() + more.points.positions.size());
  first_points_.points.colors.reserve(first_points_.points.colors.size() + more.points.colors.size());
  first_points_.views.reserve(first_points_.views.size() + more.views.size());
  const auto move = [&](std::size_t i, const glm::dmat4& by) {
    const glm::dvec3 moved(by * glm::dvec4(positions[3 * i], positions[3 * i + 1], positions[3 * i + 2], 1));
    for (int c = 0; c < 3; ++c) positions[3 * i + static_cast<std::size_t>(c)] = static_cast<float>(moved[c]);
  };
  for (std::size_t i = 0; i < first_points_.views.size() && !update.change.corrections.empty(); ++i) {
    move(i, update.change.corrections[first_points_.views[i]]);
  }
  positions.insert(positions.end(), more.points.positions.begin(), more.points.positions.end());
  first_points_.points.colors.insert(first_points_.points.colors.end(), more.points.colors.begin(),
                                     more.points.colors.end());
  first_points_.views.insert(first_points_.views.end(), more.views.begin(), more.views.end());
  if (scene_.train.size() >= static_cast<std::size_t>(slam_.initial_keyframes) && may_begin_mapping()) begin_mapping();
}

void SlamRun::take_waiting() {
  while (!take_failed_) {
    Update update;
    {
      const std::lock_guard guard(waiting_mutex_);
      if (waiting_.empty()) return;
      update = std::move(waiting_.front());
      waiting_.pop_front();
    }
    take(std::move(update));
  }
}

void SlamRun::iterate() {
  ++iteration_;
  const View& view = online_->next_view(iteration_);
  const double loss = plugged_.backbone->train_step(iteration_, view);
  if (!std::isfinite(loss)) {
    throw std::runtime_error("the loss is not finite at iteration " + std::to_string(iteration_) + " (" + view.name +
                             "); lower the learning rates in --config, or report this");
  }
  loss_ = iteration_ == 1 ? loss : loss_ + kLossWeight * (loss - loss_);
  shown_mapping_.loss = loss_;
  shown_mapping_.primitives = plugged_.backbone->primitives();
  shown_mapping_.iteration = iteration_;
}

void SlamRun::sample_curve() {
  const int last = outcome_.curve.empty() ? 0 : outcome_.curve.back().iteration;
  if (iteration_ == last) return;
  outcome_.curve.push_back({iteration_, seconds(), loss_, plugged_.backbone->primitives(), std::nullopt});
}

void SlamRun::show_progress(bool last) {
  const double at = now();
  if (options_.quiet || (!last && at - shown_ < kShownEvery)) return;
  shown_ = at;
  std::fprintf(stderr, "frame %zu/%zu  %zu tracked  %s  %s  %s  %.1f frames/s", outcome_.frames.size(),
               sequence_.size(), tracked_, counted(tracker_.keyframes(), "keyframe").c_str(),
               counted(tracker_.map_points(), "point").c_str(),
               counted(static_cast<std::size_t>(tracker_.loops()), "loop").c_str(),
               static_cast<double>(outcome_.frames.size()) / std::max(seconds(), 1e-9));
  if (const int iteration = shown_mapping_.iteration; iteration > 0) {
    std::fprintf(stderr, "  iteration %d  loss %.4f  %s", iteration, shown_mapping_.loss.load(),
                 counted(shown_mapping_.primitives, "primitive").c_str());
  }
  std::fputc('\n', stderr);
}

void SlamRun::run_in_lockstep() {
  for (std::size_t number = 0; number < sequence_.size() && !stopped_(); ++number) {
    if (std::optional<Update> update = track(number)) {
      take(std::move(*update));
      for (int i = 0; online_ != nullptr && i < *slam_.lockstep && !stopped_(); ++i) iterate();
    }
    show_progress(number + 1 == sequence_.size());
  }
}

void SlamRun::run_at_once() {
  std::atomic<bool> ended = false, given_up = false;
  std::exception_ptr failure;
  std::thread tracking([&] {
    try {
      for (std::size_t number = 0; number < sequence_.size() && !given_up && !stopped_(); ++number) {
        if (std::optional<Update> update = track(number)) {
          const std::lock_guard guard(waiting_mutex_);
          waiting_.push_back(std::move(*update));
        }
        show_progress(number + 1 == sequence_.size());
      }
    } catch (...) {
      failure = std::current_exception();
    }
    ended = true;
  });
  try {
    while (!ended) {
      take_waiting();
      if (online_ != nullptr) {
        iterate();
      } else {
        std::this_thread::sleep_for(kIdle);
      }
    }
  } catch (...) {
    given_up = true;
    tracking.join();
    throw;
  }
  tracking.join();
  if (failure) std::rethrow_exception(failure);
  take_waiting();
}

std::string SlamRun::why_nothing_was_tracked() const {
  const LackOfMap& lack = tracker_.lack_of_map();
  const std::string all = counted(outcome_.frames.size() - unusable_, "frame"),
                    least = std::to_string(kFeaturesToBegin);
  const auto of_all = [&](std::size_t count) { return "in " + std::to_string(count) + " of " + all + " "; };
  const auto metres = [](double depth) {
    char text[32];
    std::snprintf(text, sizeof text, "%.3g m", depth);
    return std::string(text);
  };
  const std::pair<std::size_t, std::string> reasons[] = {
      {lack.few_features, of_all(lack.few_features) + "the colour image has fewer than " + least +
                              " features (at most " + std::to_string(lack.most_features) +
                              "); the pictures must show texture, sharp and bright enough"},
      {lack.no_depth,
       of_all(lack.no_depth) + "there is no depth that can be used; see the messages about single frames"},
      {lack.few_depths, of_all(lack.few_depths) + "fewer than " + least + " features have depth (at most " +
                            std::to_string(lack.most_depths) +
                            "); check that depth is known where the pictures show "
                            "texture, and that it belongs to them"},
      {lack.too_far, of_all(lack.too_far) + "most features are beyond --max-depth, " +
                         metres(slam_.tracker.farthest_depth) + ": the nearest is " + metres(lack.nearest) +
                         " away; raise --max-depth, or check depth_scale of the calibration"},
      {lack.too_near, of_all(lack.too_near) + "most features are nearer than " + metres(slam_.tracker.nearest_depth) +
                          ": the farthest is " + metres(lack.farthest) + " away; check depth_scale of the calibration"},
      {lack.no_parallax,
       "no two frames show enough of the same features from different places; without depth the camera must move "
       "sideways, not only turn"}};
  return std::ranges::max_element(reasons, {}, &std::pair<std::size_t, std::string>::first)->second;
}

void SlamRun::finish_mapping() {
  if (stopped_()) return;
  take_held();
  if (online_ == nullptr) {
    require(unusable_ < outcome_.frames.size(),
            options_.scene.source.string() +
                ": nothing could be tracked: not one image can be used; see the messages about single frames");
    require(!scene_.train.empty(),
            options_.scene.source.string() + ": nothing could be tracked: " + why_nothing_was_tracked());
    begin_mapping();  // with fewer keyframes than usual
  }
  int total = online_->planned_iterations(iteration_);
  const int in_sequence = iteration_;
  if (!slam_.seconds && !options_.quiet && in_sequence > 0 && total > *options_.iterations) {
    std::fprintf(stderr,
                 "note: mapping takes %d iterations, more than the %d of --iterations: %d ran while the sequence was "
                 "tracked, and at least as many must follow\n",
                 total, *options_.iterations, in_sequence);
  }
  const double tail_began = seconds();
  // At least one iteration, in which the last changes of the map become Gaussians.
  const auto in_time = [&] { return iteration_ == in_sequence || seconds() < *slam_.seconds; };
  // The number of iterations is predicted, first from the rate in the sequence, then from that of the last ones, which
  // changes with the number of Gaussians; the clock decides when to end. A few iterations predict nothing: one of them
  // may add Gaussians, which takes as long as many others, and growth ends for good if a prediction is too small.
  int planned_at = 0;
  double planned_since = 0;
  const auto plan = [&] {
    const double now = seconds();
    const double rate = (iteration_ - planned_at) / std::max(now - planned_since, 1e-9);
    total = iteration_ + std::max(1, static_cast<int>(std::min(1e8, rate * std::max(0.0, *slam_.seconds - now))));
    planned_at = iteration_;
    planned_since = now;
  };
  if (slam_.seconds) {
    while (iteration_ < kPlannedIterations && in_time() && !stopped_()) iterate();
    plan();
  }
  online_->views_complete(total);
  Progress progress("mapping", total, iteration_, options_.quiet);
  const int shown_every = std::max(1, (total - iteration_) / kCurvePoints);
  while (!stopped_() && (slam_.seconds ? in_time() : iteration_ < total)) {
    iterate();
    if (slam_.seconds && iteration_ - planned_at == kPlannedIterations) {
      plan();
      online_->views_complete(total);
    }
    progress.update(std::min(iteration_, total), loss_, plugged_.backbone->primitives(), seconds() - tail_began);
    if (iteration_ == total || iteration_ % shown_every == 0) {
      sample_curve();
    }
  }
}

void SlamRun::follow_sequence() {
  if (slam_.lockstep) {
    run_in_lockstep();
  } else {
    run_at_once();
  }
  outcome_.sequence_seconds = seconds();
  outcome_.iterations_in_sequence = iteration_;
}

/// For a run that ends early: adds the changes that wait for the mapper. Those that can no longer be added are left
/// out.
void SlamRun::keep_what_there_is() {
  try {
    take_waiting();
    take_held();
    if (online_ == nullptr && !scene_.train.empty() && may_begin_mapping()) begin_mapping();
    if (iteration_ > 0 && !outcome_.failure) iterate();  // the changes become Gaussians
  } catch (const InputError&) {
    throw;
  } catch (const std::exception&) {
    if (online_ == nullptr) throw;
  }
}

SlamOutcome SlamRun::run() {
  began_ = shown_ = now();
  try {
    follow_sequence();
    finish_mapping();
    outcome_.complete = !stopped_();
    if (!outcome_.complete) keep_what_there_is();
    if (iteration_ > 0) plugged_.backbone->finish();
  } catch (const InputError&) {
    throw;
  } catch (const std::exception&) {
    outcome_.complete = false;
    outcome_.failure = std::current_exception();
    keep_what_there_is();
    if (scene_.train.empty()) throw;
  }
  outcome_.iterations = iteration_;
  outcome_.mapping_seconds = seconds();
  if (online_ != nullptr) {
    for (const auto& [stage, spent] : plugged_.backbone->stages().seconds()) outcome_.stage_seconds[stage] = spent;
  }
  return outcome_;
}

}  // namespace splatboost::program
