// SPDX-License-Identifier: Apache-2.0
#include "families/tracking/tracker.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>
#include <utility>

#include "families/tracking/focal_check.h"
#include "families/tracking/loop_closing.h"
#include "families/tracking/sparse_map.h"
#include "families/tracking/triangulation.h"

namespace splatboost {
namespace {

using namespace tracking;

constexpr std::size_t kMinMatches = 20;  ///< minimum number of inliers of a tracked frame
constexpr std::size_t kMinFound = 30;    ///< the same for relocalisation
/// Minimum share of the expected points that are matched: where only a pattern repeats, fewer are.
constexpr double kMinShare = 0.1;
constexpr double kGoodShare = 0.2;                      ///< from this share on, no other search is tried
constexpr std::size_t kTrialKeyframes = 5;              ///< without depth, a map with fewer is dropped …
constexpr int kTrialLost = 5;                           ///< … when tracking has been lost for this many frames
constexpr double kNarrow = 4, kUsual = 15, kWide = 40;  ///< search radii for map points, px
constexpr double kFirstSearch = 0.1;  ///< search radius around the last place of a feature, × width, without a map
constexpr std::size_t kLocalKeyframes = 10;
constexpr std::size_t kRelocalizations = 5;  ///< candidate keyframes for a lost frame
constexpr std::size_t kLoopPause = 5;        ///< keyframes after a loop without loop detection
constexpr std::size_t kPointTrial = 3;       ///< keyframes after which points are checked by kFoundShare
constexpr double kFoundShare = 0.25;         ///< minimum of MapPoint::found / expected
constexpr double kCopiedWithin = 20;  ///< px; a feature without depth takes that of the nearest map point within this

glm::dmat4 to_glm(const Pose& pose) {
  const Eigen::Matrix3d r = pose.rotation.toRotationMatrix();
  glm::dmat4 m(1.0);
  for (int column = 0; column < 3; ++column) {
    for (int row = 0; row < 3; ++row) m[column][row] = r(row, column);
    m[3][column] = pose.translation[column];
  }
  return m;
}

}  // namespace

bool have_tracking() { return true; }

struct Tracker::State {
  State(const Calibration& c, const TrackerOptions& given)
      : options(given), map({c.width, c.height, c.fx, c.fy, c.cx, c.cy}, c.has_depth()), extractor(given.features) {}

  TrackerOptions options;
  SparseMap map;
  FeatureExtractor extractor;

  /// Without depth, until there is a map: the frame that later ones are matched with, and where its features were seen
  /// last.
  std::optional<MapKeyframe> first;
  std::vector<Vec2> last_places;
  LackOfMap lack;

  // The last tracked frame, relative to a keyframe.
  std::size_t reference = 0;
  Pose last_from_reference;
  std::optional<Pose> velocity;  ///< motion between the last two tracked frames
  std::vector<int> last_points;
  std::size_t last_number = 0;
  int lost_frames = 0;              ///< since the last tracked one
  std::size_t keyframe_number = 0;  ///< frame number of the last keyframe
  std::size_t last_loop = 0;        ///< index of the keyframe that closed it
  int loops = 0;

  // Changes for the next take_change().
  std::vector<int> new_points;
  std::vector<std::size_t> new_keyframes;
  struct Place {
    Pose pose;
    double scale;
  };
  std::vector<Place> before_loop;  ///< of the keyframes; empty: no loop was closed

  Features features_of(const SequenceFrame& frame) {
    Features features = extractor.extract(frame.width, frame.height, frame.color, frame.depth, frame.valid);
    if (map.keyframes().empty()) note_lack(frame, features);
    for (double& depth : features.depths) {
      const bool usable = map.metric() && depth >= options.nearest_depth && depth <= options.farthest_depth;
      if (!usable) depth = 0;
    }
    return features;
  }

  /// @param features with all depths
  void note_lack(const SequenceFrame& frame, const Features& features) {
    lack.most_features = std::max(lack.most_features, features.size());
    std::size_t deep = 0, near = 0, far = 0;
    for (const double depth : features.depths) {
      if (!(depth > 0)) continue;
      ++deep;
      near += depth < options.nearest_depth ? 1 : 0;
      far += depth > options.farthest_depth ? 1 : 0;
      lack.nearest = std::min(lack.nearest, depth);
      lack.farthest = std::max(lack.farthest, depth);
    }
    lack.most_depths = std::max(lack.most_depths, deep);
    if (features.size() < kFeaturesToBegin) {
      ++lack.few_features;
    } else if (!map.metric()) {
      ++lack.no_parallax;
    } else if (frame.depth.empty()) {
      ++lack.no_depth;
    } else if (deep < kFeaturesToBegin) {
      ++lack.few_depths;
    } else if (deep - near - far < kFeaturesToBegin) {
      ++(near > far ? lack.too_near : lack.too_far);
    }
  }

  /// Searches for candidate map points that are not matched yet. @param count whether to update MapPoint::expected
  /// @return number of points expected in the image, including those matched before; at most that of the features
  std::size_t search(const Features& features, const FeatureGrid& grid, const Pose& pose, std::vector<int> candidates,
                     double radius, std::vector<int>& points, bool count) {
    const std::set<int> known(points.begin(), points.end());
    std::erase_if(candidates, [&](int p) { return known.contains(p) || map.point(p).gone; });
    std::vector<int> visible;
    std::vector<Expected> expected = expected_in(map, pose, candidates, radius, visible);
    const std::vector<int> found = match_expected(expected, features, grid);
    for (std::size_t i = 0; i < found.size(); ++i) {
      if (count) ++map.point(visible[i]).expected;
      if (found[i] >= 0 && points[static_cast<std::size_t>(found[i])] < 0) {
        points[static_cast<std::size_t>(found[i])] = visible[i];
      }
    }
    const std::size_t matched = known.size() - (known.contains(-1) ? 1 : 0);
    return std::min(matched + visible.size(), features.size());
  }

  static bool has_share(std::size_t matches, std::size_t expected, double share) {
    return static_cast<double>(matches) >= share * static_cast<double>(expected);
  }

  /// Keyframes that see most of `points`, at most kLocalKeyframes; most first, ties by index.
  std::vector<std::size_t> local_keyframes(const std::vector<int>& points) const {
    std::map<std::size_t, int> shared;
    for (const int p : points) {
      if (p < 0) continue;
      for (const auto& [keyframe, feature] : map.point(p).sightings) ++shared[keyframe];
    }
    std::vector<std::pair<int, std::size_t>> sorted;
    sorted.reserve(shared.size());
    for (const auto& [keyframe, number] : shared) sorted.emplace_back(-number, keyframe);
    std::ranges::sort(sorted);
    sorted.resize(std::min(kLocalKeyframes, sorted.size()));
    std::vector<std::size_t> keyframes;
    keyframes.reserve(sorted.size());
    for (const auto& [sees, keyframe] : sorted) keyframes.push_back(keyframe);
    return keyframes;
  }

  /// Points of the keyframes that see most of `points`, and of the newest keyframe.
  std::vector<int> local_points(const std::vector<int>& points) const {
    std::vector<std::size_t> keyframes = local_keyframes(points);
    keyframes.push_back(map.keyframes().size() - 1);
    return map.seen_by(keyframes);
  }

  std::size_t track_from(const Features& features, const FeatureGrid& grid, Pose& pose, std::vector<int>& points) {
    std::vector<int> candidates = last_points;
    for (const int p : map.keyframes()[reference].points) {
      if (p >= 0) candidates.push_back(p);
    }
    std::ranges::sort(candidates);
    candidates.erase(std::unique(candidates.begin(), candidates.end()), candidates.end());
    // If the camera has moved farther than expected, a few features near the expected places may still match by
    // chance. So the search that explains most is used.
    const Pose predicted = pose;
    std::size_t most = 0;
    const auto keep_best = [&](std::size_t count, std::vector<int> found, const Pose& at) {
      if (count < kMinMatches || count <= most) return;
      most = count;
      points = std::move(found);
      pose = at;
    };
    points.assign(features.size(), -1);
    for (const double radius : {kUsual, kWide}) {
      std::vector<int> found(features.size(), -1);
      Pose at = predicted;
      const std::size_t expected = search(features, grid, at, candidates, radius, found, false);
      const std::size_t count = refine(map, features, found, at);
      keep_best(count, std::move(found), at);
      if (count >= kMinMatches && has_share(count, expected, kGoodShare)) return most;
    }
    std::vector<int> found(features.size(), -1);
    Pose at = predicted;
    const std::size_t count = match_keyframe(reference, features, found, at, kMinMatches);
    keep_best(count, std::move(found), at);
    return most;
  }

  /// Matches a frame with a keyframe by descriptors alone. @return number of inliers
  std::size_t match_keyframe(std::size_t keyframe, const Features& features, std::vector<int>& points, Pose& pose,
                             std::size_t least) const {
    const MapKeyframe& known = map.keyframes()[keyframe];
    const std::vector<int> matches = match_descriptors(features.descriptors, known.features.descriptors);
    points.assign(features.size(), -1);
    for (std::size_t f = 0; f < matches.size(); ++f) {
      if (matches[f] >= 0) points[f] = known.points[static_cast<std::size_t>(matches[f])];
    }
    if (!locate(map, features, points, pose, std::min<std::size_t>(least, 15))) return 0;
    return static_cast<std::size_t>(std::ranges::count_if(points, [](int p) { return p >= 0; }));
  }

  std::size_t relocalize(const Features& features, const FeatureGrid& grid, Pose& pose, std::vector<int>& points) {
    std::vector<std::size_t> all(map.keyframes().size());
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = i;
    for (const std::size_t keyframe : similar_keyframes(map, features, all, kRelocalizations)) {
      if (match_keyframe(keyframe, features, points, pose, kMinMatches) == 0) continue;
      const std::size_t expected = search(features, grid, pose, local_points(points), kUsual, points, false);
      const std::size_t count = refine(map, features, points, pose);
      if (count >= kMinFound && has_share(count, expected, kMinShare)) {
        reference = keyframe;
        return count;
      }
    }
    return 0;
  }

  /// Matches further points of the keyframes around. @return number of inliers; 0: too few of the expected points
  std::size_t match_local(const Features& features, const FeatureGrid& grid, Pose& pose, std::vector<int>& points) {
    const std::size_t expected = search(features, grid, pose, local_points(points), kNarrow, points, true);
    const std::size_t count = refine(map, features, points, pose);
    return has_share(count, expected, kMinShare) ? count : 0;
  }

  bool is_near(const Pose& pose, const MapKeyframe& keyframe) const {
    const double shift = (pose.centre() - keyframe.pose.centre()).norm();
    const double turn = angle_between(pose, keyframe.pose) * (180 / std::numbers::pi);
    return shift <= options.keyframe_shift * keyframe.median_depth && turn <= options.keyframe_turn;
  }

  bool needs_keyframe(std::size_t frame, const Pose& pose, std::size_t matches) const {
    const MapKeyframe& last = map.keyframes().back();
    return frame >= keyframe_number + static_cast<std::size_t>(options.keyframe_gap) || !is_near(pose, last) ||
           static_cast<double>(matches) < options.keyframe_share * static_cast<double>(last.made_points);
  }

  /// An earlier keyframe taken near this pose. Returning to it instead of adding a keyframe bounds memory. The last
  /// keyframe is excluded: keyframe_gap allows a slow camera to add one within keyframe_shift and keyframe_turn.
  std::optional<std::size_t> keyframe_from_here(const Pose& pose, const std::vector<int>& points) const {
    for (const std::size_t keyframe : local_keyframes(points)) {
      if (keyframe + 1 < map.keyframes().size() && is_near(pose, map.keyframes()[keyframe])) return keyframe;
    }
    return std::nullopt;
  }

  static MapKeyframe keyframe_of(const SequenceFrame& frame, Features features, const Pose& pose) {
    MapKeyframe keyframe;
    keyframe.frame = frame.number;
    keyframe.pose = pose;
    keyframe.points.assign(features.size(), -1);
    for (const Vec2& place : features.pixels) {
      const auto pixel = static_cast<std::size_t>(std::lround(place.y())) * static_cast<std::size_t>(frame.width) +
                         static_cast<std::size_t>(std::lround(place.x()));
      keyframe.colors.push_back({frame.color[3 * pixel], frame.color[3 * pixel + 1], frame.color[3 * pixel + 2]});
    }
    keyframe.features = std::move(features);
    return keyframe;
  }

  /// Depths of the features of a keyframe, or of its map points if the map has no depth; 0: unknown.
  std::vector<double> depths_of(const MapKeyframe& keyframe) const {
    std::vector<double> depths = keyframe.features.depths;
    if (map.metric()) return depths;
    for (std::size_t f = 0; f < depths.size(); ++f) {
      if (keyframe.points[f] >= 0) depths[f] = (keyframe.pose * map.point(keyframe.points[f]).position).z();
    }
    return depths;
  }

  void measure_median_depth(MapKeyframe& keyframe) const {
    std::vector<double> depths = depths_of(keyframe);
    std::erase_if(depths, [](double depth) { return !(depth > 0); });
    if (!depths.empty()) keyframe.median_depth = median_of(std::move(depths));
  }

  /// Appends a keyframe whose features see `points` (-1: none), and makes points of those with depth.
  void add_keyframe(MapKeyframe keyframe, const std::vector<int>& points) {
    const std::size_t number = map.keyframes().size();
    map.keyframes().push_back(std::move(keyframe));
    MapKeyframe& added = map.keyframes().back();
    const Pose world_from_camera = added.pose.inverse();
    for (std::size_t f = 0; f < added.features.size(); ++f) {
      if (points[f] >= 0) {
        map.add_sighting(points[f], number, f);
      } else if (const double depth = added.features.depths[f]; depth > 0) {
        const Vec3 seen = map.optics().unproject(added.features.pixels[f], depth);
        new_points.push_back(map.add_point(world_from_camera * seen, seen.norm(), number, f));
      }
    }
    measure_median_depth(added);
    count_points(added);
    new_keyframes.push_back(number);
    keyframe_number = added.frame;
    reference = number;
  }

  static void count_points(MapKeyframe& keyframe) {
    keyframe.made_points =
        static_cast<std::size_t>(std::ranges::count_if(keyframe.points, [](int p) { return p >= 0; }));
  }

  /// Without depth, the position of a point with one sighting is unknown.
  void drop_points_seen_once() {
    for (std::size_t i = 0; i < map.points().size(); ++i) {
      const MapPoint& p = map.points()[i];
      if (!p.gone && p.sightings.size() == 1) map.remove_sighting(static_cast<int>(i), p.sightings.begin()->first);
    }
  }

  /// Removes points that were often expected but rarely found. Without depth, two sightings do not show that a match
  /// was right: a wrong one along the epipolar line fits too.
  void drop_failed_points(std::size_t keyframe) {
    if (keyframe < kPointTrial) return;
    const MapKeyframe& older = map.keyframes()[keyframe - kPointTrial];
    for (std::size_t f = 0; f < older.points.size(); ++f) {
      const int number = older.points[f];
      if (number < 0) continue;
      const MapPoint& p = map.point(number);
      if (p.keyframe != keyframe - kPointTrial || p.sightings.size() > 2) continue;
      if (map.metric() && p.found >= kFoundShare * p.expected) continue;
      const auto sightings = p.sightings;
      for (const auto& [seen_in, feature] : sightings) map.remove_sighting(number, seen_in);
    }
  }

  bool look_for_loop(std::size_t keyframe) {
    if (!options.loops || (loops > 0 && keyframe < last_loop + kLoopPause)) return false;
    const std::optional<Loop> loop = find_loop(map, keyframe);
    if (!loop) return false;
    if (before_loop.empty()) {
      for (const MapKeyframe& k : map.keyframes()) before_loop.push_back({k.pose, k.scale});
    }
    close_loop(map, *loop);
    if (velocity) velocity->translation *= map.keyframes()[keyframe].scale;
    last_loop = keyframe;
    ++loops;
    return true;
  }

  void remember(std::size_t number, const Pose& pose, std::vector<int> points) {
    last_from_reference = pose * map.keyframes()[reference].pose.inverse();
    std::erase(points, -1);
    last_points = std::move(points);
    last_number = number;
  }

  TrackedFrame track(const SequenceFrame& frame) {
    TrackedFrame result;
    result.frame = frame.number;
    if (frame.color.empty()) {
      result.state = TrackState::dropped;
      velocity.reset();
      return result;
    }
    Features features = features_of(frame);
    if (map.keyframes().empty()) {
      return map.metric() ? begin(frame, std::move(features)) : begin_with_two(frame, std::move(features));
    }

    const FeatureGrid grid(features);
    const Pose last = last_from_reference * map.keyframes()[reference].pose;
    Pose pose = velocity ? *velocity * last : last;
    std::vector<int> points;
    const bool was_lost = lost_frames > 0;
    std::size_t count = was_lost ? 0 : track_from(features, grid, pose, points);
    if (count >= kMinMatches) count = match_local(features, grid, pose, points);
    if (count < kMinMatches) {
      count = relocalize(features, grid, pose, points);
      if (count >= kMinMatches) count = match_local(features, grid, pose, points);
    }
    lost_frames = count < kMinMatches ? lost_frames + 1 : 0;
    if (lost_frames > 0) {
      velocity.reset();
      if (on_trial() && lost_frames == kTrialLost) return begin_anew(frame, std::move(features));
      result.state = TrackState::lost;
      return result;
    }
    for (const int p : points) {
      if (p >= 0) ++map.point(p).found;
    }
    result.state = TrackState::tracked;
    result.relocalized = was_lost;
    result.matches = count;
    const bool follows = !was_lost && frame.number == last_number + 1;
    velocity = follows ? std::optional(pose * last.inverse()) : std::nullopt;
    const bool due = (!map.metric() || !frame.depth.empty()) && needs_keyframe(frame.number, pose, count);
    if (const auto known = due ? keyframe_from_here(pose, points) : std::nullopt) {
      reference = *known;
    } else if (due) {
      add_keyframe(keyframe_of(frame, std::move(features), pose), points);
      const std::size_t keyframe = reference;
      if (!map.metric()) {
        const std::vector<int> added = add_triangulated_points(map, keyframe);
        new_points.insert(new_points.end(), added.begin(), added.end());
        count_points(map.keyframes()[keyframe]);
      }
      map.adjust_around(keyframe);
      if (!map.metric()) drop_points_seen_once();
      drop_failed_points(keyframe);
      result.closed_loop = look_for_loop(keyframe);
      result.is_keyframe = true;
      pose = map.keyframes()[keyframe].pose;
      points = map.keyframes()[keyframe].points;
    }
    remember(frame.number, pose, std::move(points));
    result.keyframe = reference;
    result.camera_from_keyframe = to_glm(last_from_reference);
    result.scale = map.keyframes()[reference].scale;
    return result;
  }

  TrackedFrame begin(const SequenceFrame& frame, Features features) {
    TrackedFrame result;
    result.frame = frame.number;
    const auto deep = std::ranges::count_if(features.depths, [](double d) { return d > 0; });
    if (static_cast<std::size_t>(deep) < kFeaturesToBegin) return result;
    const std::vector<int> none(features.size(), -1);
    add_keyframe(keyframe_of(frame, std::move(features), {}), none);
    return begun(frame, result);
  }

  bool on_trial() const { return !map.metric() && map.keyframes().size() < kTrialKeyframes; }

  /// Drops a map that was on trial. It closed no loop, and the next map sets what is remembered of the last frame.
  TrackedFrame begin_anew(const SequenceFrame& frame, Features features) {
    map = SparseMap(map.optics(), map.metric());
    new_points.clear();
    new_keyframes.clear();
    lost_frames = 0;
    TrackedFrame result = begin_with_two(frame, std::move(features));
    result.begins_anew = true;
    return result;
  }

  /// Without depth: keeps a frame until a later one has enough parallax to it.
  TrackedFrame begin_with_two(const SequenceFrame& frame, Features features) {
    TrackedFrame result;
    result.frame = frame.number;
    MapKeyframe second = keyframe_of(frame, std::move(features), {});
    std::vector<std::size_t> in_first, in_second;
    if (first) {
      const std::vector<int> matches = match_with_first(second.features);
      for (std::size_t f = 0; f < matches.size(); ++f) {
        if (matches[f] < 0) continue;
        in_first.push_back(f);
        in_second.push_back(static_cast<std::size_t>(matches[f]));
        last_places[f] = second.features.pixels[in_second.back()];
      }
    }
    if (in_first.size() < kFeaturesToBegin) {  // the camera has left the first view
      last_places = second.features.pixels;
      first = std::move(second);
      return result;
    }
    const std::optional<TwoViews> views =
        relate_views(map.optics(), sightings(first->features, in_first), sightings(second.features, in_second));
    if (!views) return result;
    second.pose = views->second;
    const std::vector<int> none(first->features.size(), -1);
    std::vector<int> points(second.features.size(), -1);
    add_keyframe(std::move(*first), none);
    first.reset();
    for (std::size_t i = 0; i < in_first.size(); ++i) {
      if (const auto& point = views->points[i]) {
        points[in_second[i]] = map.add_point(*point, point->norm(), 0, in_first[i]);
        new_points.push_back(points[in_second[i]]);
      }
    }
    measure_median_depth(map.keyframes()[0]);
    count_points(map.keyframes()[0]);
    add_keyframe(std::move(second), points);
    return begun(frame, result);
  }

  /// For each feature of the first frame its match, or -1: near where it was seen last, or anywhere after a jump.
  std::vector<int> match_with_first(const Features& features) const {
    std::vector<Expected> expected;
    for (std::size_t f = 0; f < first->features.size(); ++f) {
      expected.push_back({last_places[f], kFirstSearch * map.optics().width, first->features.levels[f],
                          first->features.descriptors.row(static_cast<int>(f))});
    }
    const std::vector<int> matches = match_expected(expected, features, FeatureGrid(features));
    const auto count = std::ranges::count_if(matches, [](int match) { return match >= 0; });
    return static_cast<std::size_t>(count) >= kFeaturesToBegin
               ? matches
               : match_descriptors(first->features.descriptors, features.descriptors);
  }

  static std::vector<Sighting> sightings(const Features& features, const std::vector<std::size_t>& which) {
    std::vector<Sighting> chosen;
    chosen.reserve(which.size());
    for (const std::size_t f : which) chosen.push_back(sighting_of(features, f));
    return chosen;
  }

  /// The frame that the newest keyframe was made of.
  TrackedFrame begun(const SequenceFrame& frame, TrackedFrame result) {
    const MapKeyframe& keyframe = map.keyframes()[reference];
    remember(frame.number, keyframe.pose, keyframe.points);
    result.keyframe = reference;
    result.state = TrackState::tracked;
    result.is_keyframe = true;
    result.matches = keyframe.made_points;
    return result;
  }
};

Tracker::Tracker(const Calibration& calibration, const TrackerOptions& options)
    : state_(std::make_unique<State>(calibration, options)) {}
Tracker::~Tracker() = default;

TrackedFrame Tracker::track(const SequenceFrame& frame) { return state_->track(frame); }
std::size_t Tracker::keyframes() const { return state_->map.keyframes().size(); }
bool Tracker::on_trial() const { return state_->on_trial(); }
glm::dmat4 Tracker::camera_from_world(std::size_t keyframe) const {
  return to_glm(state_->map.keyframes()[keyframe].pose);
}
glm::dmat4 Tracker::camera_from_world(const TrackedFrame& frame) const {
  glm::dmat4 motion = frame.camera_from_keyframe;
  motion[3] = glm::dvec4(state_->map.keyframes()[frame.keyframe].scale / frame.scale * glm::dvec3(motion[3]), 1);
  return motion * camera_from_world(frame.keyframe);
}
std::size_t Tracker::frame_of(std::size_t keyframe) const { return state_->map.keyframes()[keyframe].frame; }
int Tracker::loops() const { return state_->loops; }
std::optional<double> Tracker::better_focal_factor() const { return tracking::better_focal_factor(state_->map); }

const LackOfMap& Tracker::lack_of_map() const { return state_->lack; }

std::size_t Tracker::map_points() const {
  const std::vector<MapPoint>& points = state_->map.points();
  return static_cast<std::size_t>(std::ranges::count_if(points, [](const MapPoint& p) { return !p.gone; }));
}

namespace {

void add(PointCloud& cloud, const Vec3& position, const Color& color) {
  for (int c = 0; c < 3; ++c) cloud.positions.push_back(static_cast<float>(position[c]));
  cloud.colors.insert(cloud.colors.end(), color.begin(), color.end());
}

/// Gives features without depth that of the nearest feature with it, if that is close in the image (Photo-SLAM).
std::vector<double> copied_depths(const Features& features, const std::vector<double>& depths) {
  std::vector<double> copied = depths;
  const FeatureGrid grid(features);
  std::vector<std::size_t> near;
  for (std::size_t f = 0; f < depths.size(); ++f) {
    if (depths[f] > 0) continue;
    double nearest = kCopiedWithin;
    grid.within(features.pixels[f], kCopiedWithin, near);
    for (const std::size_t other : near) {
      const double away = (features.pixels[other] - features.pixels[f]).norm();
      if (!(depths[other] > 0) || away >= nearest) continue;
      nearest = away;
      copied[f] = depths[other];
    }
  }
  return copied;
}

}  // namespace

PointCloud Tracker::cloud() const {
  PointCloud cloud;
  for (const MapPoint& p : state_->map.points()) {
    if (!p.gone) add(cloud, p.position, p.color);
  }
  return cloud;
}

MapChange Tracker::take_change() {
  State& s = *state_;
  MapChange change;
  for (const int number : s.new_points) {
    const MapPoint& p = s.map.point(number);
    if (p.gone) continue;
    add(change.map_points.points, p.position, p.color);
    change.map_points.views.push_back(static_cast<std::uint32_t>(p.keyframe));
  }
  for (const std::size_t number : s.new_keyframes) {
    const MapKeyframe& keyframe = s.map.keyframes()[number];
    const Pose world_from_camera = keyframe.pose.inverse();
    std::vector<double> depths = s.depths_of(keyframe);
    if (!s.map.metric()) depths = copied_depths(keyframe.features, depths);
    for (std::size_t f = 0; f < keyframe.features.size(); ++f) {
      const double depth = depths[f];
      if (!(depth > 0)) continue;
      add(change.features.points, world_from_camera * s.map.optics().unproject(keyframe.features.pixels[f], depth),
          keyframe.colors[f]);
      change.features.views.push_back(static_cast<std::uint32_t>(number));
    }
  }
  for (std::size_t i = 0; i < s.before_loop.size(); ++i) {
    const MapKeyframe& keyframe = s.map.keyframes()[i];
    const auto& [pose, old_scale] = s.before_loop[i];
    const double scale = keyframe.scale / old_scale;
    glm::dmat4 correction = to_glm(keyframe.pose.inverse() * Pose{pose.rotation, scale * pose.translation});
    for (int column = 0; column < 3; ++column) correction[column] *= scale;
    change.corrections.push_back(correction);
  }
  s.new_points.clear();
  s.new_keyframes.clear();
  s.before_loop.clear();
  return change;
}

}  // namespace splatboost
