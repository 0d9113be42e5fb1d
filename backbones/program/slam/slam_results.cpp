// SPDX-License-Identifier: Apache-2.0
#include "program/slam/slam_results.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <set>
#include <string_view>

#include <glm/gtc/quaternion.hpp>

#include "trainer/dataset/view_image.h"
#include "trainer/evaluation/evaluate.h"
#include "trainer/formats/colmap.h"
#include "trainer/sequence/trajectory.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/own_files.h"
#include "trainer/support/text.h"

namespace splatboost::program {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr std::size_t kPictures = 8;      ///< frames whose truth and render are saved
constexpr std::size_t kMinPositions = 3;  ///< needed for an alignment

struct Means {
  double psnr = 0, ssim = 0, lpips = 0, psnr_beta1 = 0;
  std::size_t count = 0;
  void add(const MeasuredView& view) {
    psnr += view.result.psnr;
    ssim += view.result.ssim;
    lpips += view.result.lpips.value_or(0);
    psnr_beta1 += view.psnr_beta1;
    ++count;
  }
  double mean(double sum) const { return count > 0 ? sum / static_cast<double>(count) : std::nan(""); }
};

std::vector<TrackedFrame> tracked_frames(const SlamOutcome& outcome) {
  std::vector<TrackedFrame> tracked;
  for (const TrackedFrame& frame : outcome.frames) {
    if (frame.state == TrackState::tracked) tracked.push_back(frame);
  }
  return tracked;
}

/// File names of the views' PNGs: picture_names(), some of which are whole names and so have their ending already.
std::vector<std::string> png_names(const std::vector<View>& views) {
  std::vector<std::string> names = picture_names(views);
  const std::set<std::string> taken(names.begin(), names.end());
  constexpr std::string_view kEnding = ".png";
  for (std::string& name : names) {
    if (name.ends_with(kEnding) && !taken.contains(name.substr(0, name.size() - kEnding.size()))) continue;
    name += kEnding;
  }
  return names;
}

std::vector<std::string> png_names(const std::vector<TrackedFrame>& frames, const Sequence& sequence) {
  std::vector<View> views(frames.size());
  for (std::size_t i = 0; i < frames.size(); ++i) views[i].name = sequence.name_of(frames[i].frame);
  return png_names(views);
}

std::string frames_line(const Json& slam) {
  const auto number = [](const Json& count, const char* what) { return counted(count.get<std::size_t>(), what); };
  std::string others;
  for (const char* state : {"lost", "dropped", "waiting"}) {
    if (slam.at(state) > 0) others += ", " + slam.at(state).dump() + " " + state;
  }
  char rate[48];
  std::snprintf(rate, sizeof rate, " tracked at %.1f per second", slam.at("tracking_fps").get<double>());
  return "frames: " + slam.at("tracked").dump() + " of " + slam.at("frames").dump() + rate + others + ", " +
         number(slam.at("keyframes").at("frames"), "keyframe") + ", " + number(slam.at("map_points"), "point") + ", " +
         number(slam.at("loops"), "loop");
}

std::string trajectory_line(const Json& slam) {
  char line[120];
  std::snprintf(line, sizeof line, "trajectory: ATE %.4f m (RMSE%s) on a path of %.2f m",
                slam.at("ate_rmse").get<double>(), slam.at("depth").get<bool>() ? "" : ", after alignment with scale",
                slam.at("path_length").get<double>());
  return line;
}

/// @param measured number of frames
std::string quality_line(const Json& slam, double psnr, std::size_t measured) {
  const auto tracked = slam.at("tracked").get<std::size_t>();
  const std::string which = measured == tracked ? "all" : std::to_string(measured) + " of " + std::to_string(tracked);
  const Json& of_keyframes = slam.at("keyframes").at("psnr");
  char line[160];
  std::snprintf(line, sizeof line, "PSNR: %.2f dB over %s tracked frames", psnr, which.c_str());
  std::string text = line;
  if (of_keyframes.is_number()) {
    std::snprintf(line, sizeof line, ", %.2f dB over keyframes", of_keyframes.get<double>());
    text += line;
  }
  return text;
}

}  // namespace

glm::dmat4 pose_of(const SlamRun& run, const TrackedFrame& frame) { return run.tracker().camera_from_world(frame); }

std::optional<TrajectoryError> trajectory_error(const SlamRun& run, const SlamOutcome& outcome,
                                                const Sequence& sequence) {
  std::vector<glm::dvec3> found, truth;
  for (const TrackedFrame& frame : tracked_frames(outcome)) {
    const auto pose = sequence.truth(frame.frame);
    if (!pose) continue;
    found.emplace_back(glm::inverse(pose_of(run, frame))[3]);
    truth.emplace_back((*pose)[3]);
  }
  if (found.size() < kMinPositions) return std::nullopt;
  const Alignment alignment = align(found, truth, !sequence.calibration().has_depth());
  return TrajectoryError{alignment.rmse, alignment.scale, path_length(truth), found.size(), alignment.to_from};
}

void write_tracking(const SlamRun& run, const SlamOutcome& outcome, Sequence& sequence, const fs::path& folder) {
  std::vector<TimedPose> poses;
  for (const TrackedFrame& frame : tracked_frames(outcome)) {
    poses.push_back({sequence.time_of(frame.frame), glm::inverse(pose_of(run, frame))});
  }
  write_tum_trajectory(folder / "trajectory.txt", poses);
  poses.clear();
  for (std::size_t i = 0; i < outcome.keyframe_frames.size(); ++i) {
    poses.push_back({sequence.time_of(outcome.keyframe_frames[i]), glm::inverse(run.tracker().camera_from_world(i))});
  }
  write_tum_trajectory(folder / "keyframes.txt", poses);

  const Scene& scene = run.scene();
  make_folder(folder / "keyframes" / "images");
  make_folder(folder / "keyframes" / "sparse" / "0");
  ColmapModel model;
  const Camera& first = scene.train.front().camera;
  model.cameras.push_back({1,
                           1,
                           static_cast<std::uint64_t>(first.width),
                           static_cast<std::uint64_t>(first.height),
                           {first.fx, first.fy, first.cx, first.cy}});
  const std::vector<std::string> names = png_names(scene.train);
  for (std::size_t i = 0; i < scene.train.size(); ++i) {
    const View& view = scene.train[i];
    ColmapImage image;
    image.id = static_cast<std::uint32_t>(i + 1);
    image.camera_id = 1;
    image.name = names[i];
    const glm::dmat4 camera_from_world = run.tracker().camera_from_world(i);
    const glm::dquat q = glm::quat_cast(glm::dmat3(camera_from_world));
    const std::array<double, 4> wxyz{q.w, q.x, q.y, q.z};
    std::ranges::copy(wxyz, image.rotation);
    for (int c = 0; c < 3; ++c) image.translation[c] = camera_from_world[3][c];
    write_png(folder / "keyframes" / "images" / image.name, view.color, view.camera.width, view.camera.height);
    model.images.push_back(std::move(image));
  }
  model.points = run.tracker().cloud();
  write_colmap_model(folder / "keyframes" / "sparse" / "0", model);
}

Json measure_frames(SlamRun& run, const SlamOutcome& outcome, Sequence& sequence, int resolution, Lpips* lpips,
                    const fs::path& folder, const std::function<bool()>& stopped, Results& results,
                    std::vector<ReportView>& views) {
  const std::vector<TrackedFrame> tracked = tracked_frames(outcome);
  const std::set<std::size_t> keyframes(outcome.keyframe_frames.begin(), outcome.keyframe_frames.end());
  std::set<std::size_t> pictured;
  for (std::size_t i = 0; i < kPictures && !tracked.empty(); ++i) {
    pictured.insert(i * (tracked.size() - 1) / std::max<std::size_t>(kPictures - 1, 1));
  }
  make_folder(folder / "test" / "renders");
  make_folder(folder / "test" / "truth");
  const std::vector<std::string> names = png_names(tracked, sequence);
  std::size_t unreadable = 0;
  Means all, of_keyframes;
  std::vector<float> color;
  double render_seconds = 0;
  for (std::size_t i = 0; i < tracked.size() && !stopped(); ++i) {
    const SequenceFrame frame = sequence.read(tracked[i].frame);
    if (frame.color.empty()) {
      ++unreadable;
      continue;
    }
    const View view = view_of(frame, sequence.calibration(), resolution, pose_of(run, tracked[i]));
    MeasuredView measured = measure_view(run.backbone(), view, lpips, color);
    render_seconds += measured.render_seconds;
    all.add(measured);
    if (keyframes.contains(tracked[i].frame)) of_keyframes.add(measured);
    if (pictured.contains(i)) {
      write_png(folder / "test" / "renders" / names[i], color, view.camera.width, view.camera.height);
      write_png(folder / "test" / "truth" / names[i], view.color, view.camera.width, view.camera.height);
      views.push_back({frame.name, folder / "test" / "truth" / names[i]});
    }
    results.views.push_back(std::move(measured.result));
  }
  if (unreadable > 0) {
    std::fprintf(stderr, "warning: %zu of %zu tracked frames could not be read again; measured on %zu\n", unreadable,
                 tracked.size(), all.count);
  }
  if (stopped()) all = of_keyframes = {};  // means of the first frames could be mistaken for those of all
  results.split = "tracked";
  results.psnr = all.mean(all.psnr);
  results.ssim = all.mean(all.ssim);
  results.psnr_beta1 = all.mean(all.psnr_beta1);
  if (lpips != nullptr && all.count > 0) results.lpips = all.mean(all.lpips);
  results.fps = all.count > 0 && render_seconds > 0 ? static_cast<double>(all.count) / render_seconds : std::nan("");
  const auto shown = [](double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); };
  return {{"frames", outcome.keyframe_frames.size()},
          {"psnr", shown(of_keyframes.mean(of_keyframes.psnr))},
          {"ssim", shown(of_keyframes.mean(of_keyframes.ssim))},
          {"lpips", lpips != nullptr ? shown(of_keyframes.mean(of_keyframes.lpips)) : Json(nullptr)}};
}

std::vector<ReportTrack> report_tracks(const SlamRun& run, const SlamOutcome& outcome, const Sequence& sequence,
                                       const std::optional<TrajectoryError>& error) {
  constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  std::vector<glm::dvec3> found, truth;
  glm::dvec3 low(std::numeric_limits<double>::infinity()), high(-low);
  for (const TrackedFrame& frame : outcome.frames) {
    const auto add = [&](std::vector<glm::dvec3>& path, const std::optional<glm::dvec3>& at) {
      path.push_back(at.value_or(glm::dvec3(kUnknown)));
      if (at) low = glm::min(low, *at), high = glm::max(high, *at);
    };
    std::optional<glm::dvec3> position;
    if (frame.state == TrackState::tracked) {
      const glm::dvec4 centre = glm::inverse(pose_of(run, frame))[3];
      position = glm::dvec3(error ? error->truth_from_map * centre : centre);
    }
    add(found, position);
    const auto pose = sequence.truth(frame.frame);
    if (error) add(truth, pose ? std::optional(glm::dvec3((*pose)[3])) : std::nullopt);
  }
  const glm::dvec3 size = high - low;
  const int along = size.x <= size.y && size.x <= size.z ? 0 : size.y <= size.z ? 1 : 2;
  const auto flat = [&](const std::vector<glm::dvec3>& path) {
    std::vector<std::array<double, 2>> points;
    points.reserve(path.size());
    for (const glm::dvec3& p : path) points.push_back({p[(along + 1) % 3], p[(along + 2) % 3]});
    return points;
  };
  // Without depth the map has a unit of its own, until it is aligned to the truth.
  if (!error) return {{"tracked", flat(found), sequence.calibration().has_depth() ? "m" : ""}};
  return {{"truth", flat(truth)}, {"tracked", flat(found)}};
}

std::vector<ReportView> measure_keyframes(Backbone& backbone, const Scene& keyframes, Lpips* lpips,
                                          const fs::path& folder, Results& results) {
  const fs::path pictures = folder / "train";
  // Those of tracked frames, which were not measured.
  constexpr OwnEntry kTracked[] = {{"test", R"((renders|truth)/[^/]+\.png)"}};
  try {
    if (!find_foreign_file(folder, kTracked)) remove_own_files(folder, kTracked);
  } catch (const InputError&) {
    // The measurement does not need it.
  }
  evaluate(backbone, keyframes, lpips, pictures / "renders", results);
  make_folder(pictures / "truth");
  const std::vector<std::string> names = picture_names(keyframes.train);
  std::vector<ReportView> views;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const View& view = keyframes.train[i];
    views.push_back({view.name, pictures / "truth" / (names[i] + ".png")});
    write_png(views.back().truth, view.color, view.camera.width, view.camera.height);
  }
  return views;
}

std::vector<std::string> tracking_lines(const Json& results) {
  const Json& slam = results.at("slam");
  std::vector<std::string> lines;
  if (!slam.at("complete").get<bool>()) {
    std::size_t frames = 0;
    for (const char* state : {"tracked", "lost", "dropped", "waiting"}) frames += slam.at(state).get<std::size_t>();
    lines.push_back("interrupted after frame " + std::to_string(frames) + " of " + slam.at("frames").dump() +
                    ", iteration " + results.at("iterations").dump());
  }
  lines.push_back(frames_line(slam));
  if (slam.at("ate_rmse").is_number()) lines.push_back(trajectory_line(slam));
  if (results.at("split") == "tracked" && results.at("psnr").is_number()) {
    lines.push_back(quality_line(slam, results.at("psnr").get<double>(), results.at("views").size()));
  }
  return lines;
}

void write_slam_report(const fs::path& folder, const std::string& label, const Results& results, const Json& json,
                       const std::vector<ReportView>& views, const std::vector<ReportTrack>& tracks) {
  const fs::path pictures = folder / (results.split == "train" ? "train" : "test");
  write_report(folder / "report.html", results.source + " — " + results.backbone + ", " + label,
               {{label, results, pictures / "renders", {}, {}, tracking_lines(json)}}, views, 4, tracks);
}

}  // namespace splatboost::program
