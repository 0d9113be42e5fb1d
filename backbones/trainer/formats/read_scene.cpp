// SPDX-License-Identifier: Apache-2.0
#include "trainer/formats/read_scene.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <tuple>
#include <utility>

#include <glm/geometric.hpp>
#include <nlohmann/json.hpp>

#include "splatboost/constants.h"
#include "splatboost/threads.h"
#include "trainer/dataset/scene_depths.h"
#include "trainer/dataset/splat_ply.h"
#include "trainer/dataset/view_image.h"
#include "trainer/formats/colmap.h"
#include "trainer/formats/frame_times.h"
#include "trainer/formats/nerfies.h"
#include "trainer/formats/neural_video.h"
#include "trainer/formats/packed_scene.h"
#include "trainer/formats/scene_split.h"
#include "trainer/formats/transforms.h"
#include "trainer/images/video.h"
#include "trainer/points/initial_points.h"
#include "trainer/points/triangulated_points.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"
#include "trainer/support/text.h"

namespace splatboost {
namespace {

// Squared distances must be finite floats, with a margin for training. No survey is larger than this, not even one of
// the earth in millimetres.
constexpr float kFarthest = 1e12f;
constexpr char kImages[] = "images";
constexpr char kCaptureImages[] = "rgb/1x";  // for Nerfies captures
constexpr int kFrames = 24;
constexpr int kResolution = -1;

/// What a dataset lists, before any photo is decoded.
struct Dataset {
  std::filesystem::path listing;        ///< the file to name in error messages
  std::vector<std::string> names;       ///< of all photos; those of the dataset's own test split come last
  std::optional<std::size_t> own_test;  ///< number of photos in that test split; none: the dataset has none
  bool blender = false;
  std::string images = kImages;  ///< image folder, for datasets that support --images
  bool takes_images = false;     ///< whether --images has an effect
  bool takes_times = false;      ///< whether --frame-times has an effect
  std::optional<int> frames;     ///< requested frames per camera of a rig of videos
  PointCloud points;
  std::filesystem::path points_file;  ///< where the points are from, for error messages
  std::vector<std::string> notes;
  std::vector<Photo> photos;                  ///< if the source is a folder
  std::shared_ptr<const PackedScene> packed;  ///< if the source is a packed scene
};

void read_points(const std::filesystem::path& file, Dataset& dataset) {
  dataset.points = read_point_ply(file);
  dataset.points_file = file;
}

Dataset read_colmap(const SceneOptions& options, const std::filesystem::path& folder) {
  ColmapModel model = read_colmap_model(folder);
  Dataset dataset;
  dataset.listing = model.images_file;
  dataset.images = options.images.value_or(kImages);
  dataset.takes_images = dataset.takes_times = true;
  const std::filesystem::path images = options.source / dataset.images;
  std::error_code ignored;
  if (!model.images.empty() && !std::filesystem::is_directory(images, ignored)) {
    throw InputError(images.string() + ": the image folder does not exist; name the right one with --images");
  }
  dataset.photos = colmap_photos(model, images);
  if (folder.filename() == "0") {
    if (const auto larger = find_larger_model(folder, model.images.size())) {
      dataset.notes.push_back(larger->string() + ": has more images than the model in " + folder.string() +
                              ", which is used; to use the larger one, exchange the two folders");
    }
  }
  if (options.frame_times) dataset.notes.push_back(set_frame_times(dataset.photos, dataset.listing.string()));
  dataset.points = std::move(model.points);
  dataset.points_file = model.points_file;
  return dataset;
}

Dataset read_blender(const SceneOptions& options, const std::filesystem::path& train) {
  Dataset dataset;
  dataset.listing = train;
  dataset.blender = true;
  Transforms transforms = read_transforms(train);
  dataset.photos = std::move(transforms.photos);
  if (const auto test = options.source / "transforms_test.json"; is_file(test)) {
    Transforms held_out = read_transforms(test);
    if (held_out.timed != transforms.timed && !held_out.photos.empty() && !dataset.photos.empty()) {
      const auto& [without, with] = transforms.timed ? std::tie(test, train) : std::tie(train, test);
      throw InputError(without.string() + ": the frames have no 'time', but those of " + with.filename().string() +
                       " have one; give a time to every frame, or to none");
    }
    dataset.own_test = held_out.photos.size();
    std::ranges::move(held_out.photos, std::back_inserter(dataset.photos));
  } else if (options.eval && options.test_list.empty()) {
    dataset.notes.push_back(test.string() + ": missing, so every " + std::to_string(options.llffhold) +
                            "th training view is a test view");
  }
  if (!transforms.points_file.empty()) {
    read_points(transforms.points_file, dataset);
  } else if (const auto points = options.source / "points3d.ply"; is_file(points)) {
    read_points(points, dataset);  // where 3DGS stores its random initial points
  }
  return dataset;
}

Dataset read_frames(const std::filesystem::path& file) {
  Dataset dataset;
  dataset.listing = file;
  Transforms transforms = read_transforms(file);
  std::vector<Photo> test;
  std::size_t left_out = 0;
  for (std::size_t i = 0; i < transforms.photos.size(); ++i) {
    const bool is_test = !transforms.test.empty() && transforms.test[i];
    const bool is_train = transforms.train.empty() ? !is_test : transforms.train[i];
    if (is_train) dataset.photos.push_back(transforms.photos[i]);
    if (is_test) test.push_back(transforms.photos[i]);
    if (!is_train && !is_test) ++left_out;
  }
  if (left_out > 0) {
    dataset.notes.push_back(
        file.string() + ": " + counted(left_out, "frame") + (left_out == 1 ? " is" : " are") +
        " left out: not in the " +
        (transforms.test.empty() ? "list of training frames" : "lists of training and test frames"));
  }
  if (!transforms.test.empty()) dataset.own_test = test.size();
  std::ranges::stable_sort(dataset.photos, {}, &Photo::name);
  std::ranges::stable_sort(test, {}, &Photo::name);
  std::ranges::move(test, std::back_inserter(dataset.photos));
  if (!transforms.points_file.empty()) read_points(transforms.points_file, dataset);
  return dataset;
}

Dataset read_capture(const SceneOptions& options) {
  Dataset dataset;
  dataset.listing = options.source / "dataset.json";
  dataset.images = options.images.value_or(kCaptureImages);
  dataset.takes_images = true;
  NerfiesCapture capture = read_nerfies(options.source, dataset.images);
  dataset.photos = std::move(capture.photos);
  dataset.own_test = capture.test;
  dataset.points = std::move(capture.points);
  dataset.points_file = options.source / "points.npy";
  return dataset;
}

Dataset read_rig(const SceneOptions& options) {
  Dataset dataset;
  dataset.listing = options.source / "poses_bounds.npy";
  dataset.frames = options.frames.value_or(kFrames);
  NeuralVideo rig = read_neural_video(options.source, *dataset.frames);
  dataset.photos = std::move(rig.photos);
  dataset.own_test = rig.test;
  dataset.notes = std::move(rig.notes);
  for (const char* name : {"points3d.ply", "points3D.ply", "points3D_downsample2.ply"}) {
    const auto points = options.source / name;
    if (dataset.points.size() == 0 && is_file(points)) read_points(points, dataset);
  }
  return dataset;
}

/// Whether any frame of a transforms file has a time above 0.
bool has_times(const std::filesystem::path& transforms) {
  std::ifstream in(transforms);
  const nlohmann::json listing = nlohmann::json::parse(in, nullptr, false, true);
  if (!listing.is_object() || !listing.contains("frames") || !listing["frames"].is_array()) return false;
  return std::ranges::any_of(listing["frames"], [](const nlohmann::json& frame) {
    return frame.is_object() && frame.contains("time") && frame["time"].is_number() && frame["time"].get<double>() > 0;
  });
}

Dataset read_folder(const SceneOptions& options) {
  const std::filesystem::path& source = options.source;
  // Dynamic datasets first: their folders often also hold a static model of one moment, for the initial points.
  if (is_nerfies_capture(source)) return read_capture(options);
  if (is_neural_video(source)) return read_rig(options);
  if (const auto model = find_colmap_model(source)) {
    // A transforms file without times is ignored if there is a COLMAP model.
    const auto train = source / "transforms_train.json", frames = source / "transforms.json";
    if (is_file(train) && has_times(train)) return read_blender(options, train);
    if (is_file(frames) && has_times(frames)) return read_frames(frames);
    return read_colmap(options, *model);
  }
  if (const auto file = source / "transforms_train.json"; is_file(file)) return read_blender(options, file);
  if (const auto file = source / "transforms.json"; is_file(file)) return read_frames(file);
  std::error_code error;
  static_cast<void>(std::filesystem::directory_iterator(source, error));
  require(!error, source.string() + ": cannot be read: " + error.message());
  for (const char* const name : {"traj.txt", "rgb.txt", "mav0"}) {  // of Replica, TUM and EuRoC
    require(!std::filesystem::exists(source / name, error),
            source.string() + ": is a sequence, without camera poses of a dataset: use splatboost slam");
  }
  throw InputError(source.string() +
                   ": holds no dataset (looked for sparse/0/cameras.bin, sparse/0/cameras.txt, "
                   "sparse/cameras.bin, sparse/cameras.txt, transforms_train.json, transforms.json, dataset.json, "
                   "poses_bounds.npy with videos)");
}

/// Throws InputError if the options ask for other images than the packed ones.
void check_packed_pictures(const SceneOptions& options, const PackedListing& listing) {
  const std::string again = "; pack the scene again with that option";
  require(options.photo_scale == 1, options.source.string() +
                                        ": holds its photos at one size, but ncc_scale needs another; give the "
                                        "original scene folder");
  if (options.images && *options.images != listing.images) {
    throw InputError(options.source.string() + ": was packed from the image folder '" + listing.images +
                     "', but --images is '" + *options.images + "'" + again);
  }
  if (options.frames && listing.frames && *options.frames != *listing.frames) {
    throw InputError(options.source.string() + ": was packed with --frames " + std::to_string(*listing.frames) +
                     ", but --frames is " + std::to_string(*options.frames) + again);
  }
  const auto is_moving = [](const PackedPhoto& photo) { return photo.view.time > 0; };
  if (options.frame_times && std::ranges::none_of(listing.photos, is_moving)) {
    throw InputError(options.source.string() +
                     ": its images were packed without times; pack the scene again with --frame-times");
  }
  if (!options.resolution) return;
  for (const PackedPhoto& photo : listing.photos) {
    const ImageSize asked = target_size(photo.photo_width, photo.photo_height, *options.resolution);
    const ImageSize packed{photo.view.camera.width, photo.view.camera.height};
    if (asked == packed) continue;
    const auto text = [](ImageSize size) { return std::to_string(size.width) + "x" + std::to_string(size.height); };
    throw InputError(options.source.string() + ": its images were packed at " + text(packed) + ", but --resolution " +
                     std::to_string(*options.resolution) + " requires " + text(asked) + again);
  }
}

Dataset read_packed(const SceneOptions& options) {
  Dataset dataset;
  dataset.listing = options.source;
  dataset.packed = std::make_shared<const PackedScene>(options.source);
  const PackedListing& listing = dataset.packed->listing();
  check_packed_pictures(options, listing);
  for (const PackedPhoto& photo : listing.photos) dataset.names.push_back(photo.view.name);
  if (listing.has_test_split) dataset.own_test = listing.own_test;
  dataset.blender = listing.blender;
  dataset.frames = listing.frames;
  // The listing does not tell nerfstudio's scenes from COLMAP's.
  dataset.takes_images = dataset.takes_times = !listing.blender && !listing.frames;
  dataset.points = listing.points;
  dataset.points_file = options.source;
  return dataset;
}

std::string number_text(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

/// Throws InputError if a position [3] is too far from the origin to train with.
/// @param name function that names what is at the position, for the message
template <class Name>
void check_position(const float* place, const std::filesystem::path& file, const Name& name) {
  for (int axis = 0; axis < 3; ++axis) {
    if (std::abs(place[axis]) <= kFarthest) continue;
    if (std::isnan(place[axis]))
      throw InputError(file.string() + ": " + name() + " is at a place that is not a number");
    throw InputError(file.string() + ": " + name() + " is " + number_text(std::abs(place[axis])) +
                     " units away from the origin, farther than " + number_text(kFarthest) +
                     "; scale the scene down, or remove it from the dataset");
  }
}

void check_points(const PointCloud& points, const std::filesystem::path& file) {
  for (std::size_t i = 0; i < points.size(); ++i) {
    check_position(points.positions.data() + 3 * i, file, [&] { return "point " + std::to_string(i); });
  }
}

void check_camera_position(const View& view, const std::filesystem::path& listing) {
  const glm::vec3 centre = view.camera.centre();
  check_position(&centre[0], listing, [&] { return "the camera of image '" + view.name + "'"; });
}

/// Throws InputError if a photo is listed twice: it could be both a training and a test view. A video has many photos,
/// and a picture may be listed for several times. Copies in the dataset's own test views are only noted: 3DGS requires
/// a transforms_test.json, so some scenes have a copy of transforms_train.json.
void check_listed_once(Dataset& dataset) {
  std::map<std::tuple<std::string, int, double>, bool> listed;  // whether in the test views
  std::size_t copies = 0;
  for (std::size_t i = 0; i < dataset.names.size(); ++i) {
    std::tuple<std::string, int, double> photo;
    if (dataset.packed) {
      const View& view = dataset.packed->listing().photos[i].view;
      photo = {view.name, -1, view.time};
    } else {
      const Photo& from = dataset.photos[i];
      photo = {from.file.lexically_normal().string(), from.video_frame, from.time};
    }
    const bool is_test = i >= dataset.names.size() - dataset.own_test.value_or(0);
    const auto [first, added] = listed.try_emplace(std::move(photo), is_test);
    if (added) continue;
    if (first->second == is_test) {
      throw InputError((dataset.packed ? dataset.listing : dataset.photos[i].listed_in).string() +
                       ": lists the image '" + dataset.names[i] + "' twice; remove one of the two entries" +
                       (dataset.packed ? " from the original dataset and pack that again" : ""));
    }
    ++copies;
  }
  if (copies > 0) {
    dataset.notes.push_back(std::to_string(copies) + " images are both training and test views of the dataset: with " +
                            "--eval the test views are also trained on");
  }
}

/// Adds a line for each option that was given and has no effect on this dataset.
void note_unused_options(const SceneOptions& options, Dataset& dataset) {
  const auto note = [&](const std::string& option, const std::string& kind) {
    dataset.notes.push_back(option + " has no effect on " + dataset.listing.string() + ": it is for " + kind);
  };
  if (options.images && !dataset.takes_images) note("--images", "COLMAP scenes and captures of Nerfies");
  if (options.frames && !dataset.frames) note("--frames", "rigs of videos");
  if (options.frame_times && !dataset.takes_times) note("--frame-times", "COLMAP scenes");
}

Dataset read_dataset(const SceneOptions& options) {
  const std::filesystem::path& source = options.source;
  std::error_code ignored;
  if (source.empty()) throw InputError("no scene is given; name its folder with --source");
  if (!std::filesystem::exists(source, ignored)) throw InputError(source.string() + ": does not exist");
  Dataset dataset;
  if (std::filesystem::is_directory(source, ignored)) {
    dataset = read_folder(options);
    for (const Photo& photo : dataset.photos) dataset.names.push_back(photo.name);
  } else if (!is_file(source)) {
    throw InputError(source.string() + ": is neither a folder nor a file; --source takes a scene or a packed scene");
  } else if (is_packed_scene(source)) {
    dataset = read_packed(options);
  } else {
    throw InputError(source.string() +
                     ": is neither a folder nor a packed scene of SplatBoost; --source takes one of them");
  }
  if (dataset.names.empty()) throw InputError(dataset.listing.string() + ": lists no images");
  for (const std::string& name : dataset.names) {
    // Names go into JSON results, which must be UTF-8, and into paths, which end at a zero byte.
    if (is_utf8(name) && name.find('\0') == std::string::npos) continue;
    throw InputError(dataset.listing.string() + ": the name of the image '" + name +
                     "' is not UTF-8; rename the image file and its entry in the dataset");
  }
  check_listed_once(dataset);
  check_points(dataset.points, dataset.points_file);
  note_unused_options(options, dataset);
  return dataset;
}

/// Where few-view datasets keep the points triangulated from these few views alone. The points of the COLMAP model come
/// from all photos, including the held-out ones.
std::filesystem::path few_view_file(const std::filesystem::path& source, int views) {
  return source / (std::to_string(views) + "_views") / "dense" / "fused.ply";
}

std::optional<PointCloud> few_view_points(const SceneOptions& options, const Dataset& dataset) {
  if (options.n_views == 0) return std::nullopt;
  if (dataset.packed) {
    const auto& clouds = dataset.packed->listing().few_view_points;
    const auto found = clouds.find(options.n_views);
    return found == clouds.end() ? std::nullopt : std::optional(found->second);
  }
  const std::filesystem::path file = few_view_file(options.source, options.n_views);
  return is_file(file) ? std::optional(read_point_ply(file)) : std::nullopt;
}

/// The few-view points in the folder, for every number of views that it has.
std::map<int, PointCloud> all_few_view_points(const std::filesystem::path& source) {
  std::map<int, PointCloud> clouds;
  for (const auto& entry : std::filesystem::directory_iterator(source)) {
    const std::string name = entry.path().filename().string();
    int views = 0;
    std::from_chars(name.data(), name.data() + name.size(), views);
    if (views < 1 || name != std::to_string(views) + "_views") continue;
    const std::filesystem::path file = few_view_file(source, views);
    if (is_file(file)) clouds[views] = read_point_ply(file);
  }
  return clouds;
}

/// Reads photos in parallel on all CPUs that the process may use. Results are in order; if several photos are broken,
/// the first is reported.
std::vector<LoadedView> load_photos(std::span<const Photo> photos, const ImageOptions& options) {
  std::vector<LoadedView> views(photos.size());
  // Each video is decoded once, from its beginning.
  std::map<std::filesystem::path, std::vector<std::size_t>> of_videos;
  for (std::size_t i = 0; i < photos.size(); ++i) {
    if (photos[i].video_frame >= 0) of_videos[photos[i].file].push_back(i);
  }
  std::vector<std::vector<std::size_t>> videos;
  for (auto& [file, wanted] : of_videos) {
    std::ranges::sort(wanted, {}, [&](std::size_t i) { return photos[i].video_frame; });
    videos.push_back(std::move(wanted));
  }
  Threads().for_range(videos.size(), 1, [&](std::size_t v, std::size_t) {
    VideoFrames frames(photos[videos[v].front()].file);
    int next = 0;
    for (const std::size_t i : videos[v]) {
      Pixels pixels;
      for (; next <= photos[i].video_frame; ++next) pixels = frames.next();
      views[i] = load_view(photos[i], options, std::move(pixels));
    }
  });
  Threads().for_range(photos.size(), 1, [&](std::size_t i, std::size_t) {
    if (photos[i].video_frame < 0) views[i] = load_view(photos[i], options);
  });
  return views;
}

void check_options(const SceneOptions& options) {
  if (options.resolution) check_resolution(*options.resolution);
  if (options.eval && options.llffhold < 1) {
    throw InputError("llffhold " + std::to_string(options.llffhold) +
                     " is not possible: every N-th image is held out, N at least 2");
  }
  if (options.frames && *options.frames < 0)
    throw InputError("frames " + std::to_string(*options.frames) + " is not possible: use 0 for all frames");
  if (options.n_views < 0)
    throw InputError("n-views " + std::to_string(options.n_views) + " is not possible: use 0 for all views");
}

/// Adds a line if the resolution is a width that no photo has.
void note_resolution(const SceneOptions& options, int widest, std::vector<std::string>& notes) {
  const int resolution = options.resolution.value_or(kResolution);
  if (resolution <= widest || target_size(widest, 1, resolution).width != widest) return;
  notes.push_back("--resolution " + std::to_string(resolution) + " has no effect: the photos are at most " +
                  std::to_string(widest) + " px wide, and photos are not enlarged");
}

void note_images(const SceneOptions& options, const std::vector<LoadedView>& loaded, std::vector<std::string>& notes) {
  std::size_t limited = 0, undistorted = 0;
  int widest = 0;
  for (const LoadedView& view : loaded) {
    limited += view.limited ? 1 : 0;
    undistorted += view.undistorted ? 1 : 0;
    widest = std::max(widest, view.photo_size.width);
  }
  if (limited > 0) {
    notes.push_back("photos are " + std::to_string(widest) +
                    " px wide and were reduced to 1600 px; use --resolution 1 for full resolution");
  }
  if (undistorted > 0) notes.push_back(std::to_string(undistorted) + " photos were undistorted");
  note_resolution(options, widest, notes);
}

ImageOptions image_options(const SceneOptions& options) {
  return {options.resolution.value_or(kResolution), options.photo_scale, options.white_background};
}

struct LoadedViews {
  std::vector<View> views;
  bool transparent = false;  ///< whether any photo has transparent pixels
};

/// Loads the chosen photos (indices into Dataset::names), in the order of `chosen`.
LoadedViews load_views(const SceneOptions& options, const Dataset& dataset, std::span<const std::size_t> chosen,
                       std::vector<std::string>& notes) {
  LoadedViews result;
  std::vector<View>& views = result.views;
  if (dataset.packed) {
    int widest = 0;
    for (const std::size_t i : chosen) {
      const PackedPhoto& photo = dataset.packed->listing().photos[i];
      views.push_back(dataset.packed->load(i, options.white_background));
      widest = std::max(widest, photo.photo_width);
      result.transparent = result.transparent || photo.transparent;
    }
    note_resolution(options, widest, notes);
    for (const View& view : views) check_camera_position(view, dataset.listing);
    return result;
  }
  std::vector<Photo> photos;
  for (const std::size_t i : chosen) photos.push_back(dataset.photos[i]);
  std::vector<LoadedView> loaded = load_photos(photos, image_options(options));
  note_images(options, loaded, notes);
  for (LoadedView& view : loaded) {
    result.transparent = result.transparent || view.transparent;
    views.push_back(std::move(view.view));
  }
  for (const View& view : views) check_camera_position(view, dataset.listing);
  return result;
}

/// @param positions [N,3], N at least 1
bool all_at_one_place(std::span<const float> positions) {
  for (std::size_t k = 3; k < positions.size(); ++k) {
    if (positions[k] != positions[k % 3]) return false;
  }
  return true;
}

/// Adds a note if much of what the views show is before their near plane. The user can give the scene other units.
void note_near_plane(Scene& scene) {
  constexpr double kMuch = 0.02;
  const double share = scene.lacks_points ? 0 : share_nearer(scene, static_cast<double>(kNearPlane));
  if (share < kMuch) return;
  scene.notes.push_back(std::to_string(std::lround(100 * share)) + " % of the points in the views are nearer than " +
                        number_text(static_cast<double>(kNearPlane)) +
                        " units, where nothing is drawn (near plane); scale poses and points up");
}

/// The distance from `centre` within which 99 % of the points are: a few may be wrong. 0 if there are none.
float far_distance(const PointCloud& points, const glm::vec3& centre) {
  constexpr double kPartOfPoints = 0.99;
  std::vector<float> distances;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const float* p = points.positions.data() + 3 * i;
    distances.push_back(glm::length(glm::vec3(p[0], p[1], p[2]) - centre));
  }
  if (distances.empty()) return 0;
  const auto last = static_cast<double>(distances.size() - 1);
  const auto far = distances.begin() + static_cast<std::ptrdiff_t>(std::ceil(kPartOfPoints * last));
  std::ranges::nth_element(distances, far);
  return *far;
}

/// Adds a note if 32-bit numbers, which poses and points are stored in, are too coarse where the cameras are.
void note_distance(Scene& scene) {
  constexpr double kFinest = 1e-4;  // × extent
  double farthest = 0;
  for (const View& view : scene.train) {
    farthest = std::max(farthest, static_cast<double>(glm::length(view.camera.centre())));
  }
  const double step = farthest * static_cast<double>(std::numeric_limits<float>::epsilon());
  if (!(step > kFinest * static_cast<double>(scene.extent))) return;
  char text[200];
  std::snprintf(text, sizeof text,
                "the cameras are %.3g units from the origin, where single precision has steps of %.1g, and the size of "
                "the scene is %.3g: subtract an offset from its poses and points",
                farthest, step, static_cast<double>(scene.extent));
  scene.notes.push_back(text);
}

/// Sets the points of a dataset without usable ones. Adds a line on what they are to Scene::notes.
void make_points(const SceneOptions& options, const Dataset& dataset, Scene& scene) {
  const std::string reason =
      scene.points.size() == 0 ? "the dataset has no points" : "all points of the dataset are at the same place";
  scene.points = {};
  const bool timed = std::ranges::any_of(scene.train, [](const View& view) { return view.time > 0; });
  std::string too_few;
  // Rendered scenes start from random points in the published methods, whose results are compared.
  if (!dataset.blender || !(scene.cut_out || timed)) {
    scene.points = triangulate_surfaces(scene, Threads());
    if (scene.points.size() > 0) {
      scene.notes.push_back(reason + "; " + std::to_string(scene.points.size()) + " were triangulated from its photos");
      return;
    }
    too_few = ", and too few could be triangulated from its photos";
  }
  if (options.random_points < 1) {
    throw InputError(dataset.listing.string() + ": " + reason + ", and random_points is " +
                     std::to_string(options.random_points));
  }
  scene.notes.push_back(reason + too_few + "; " + std::to_string(options.random_points) + " random ones are used");
  const PointBox box = dataset.blender ? synthetic_box() : look_at_box(scene.train);
  scene.points = random_points(box, options.random_points, options.seed);
}

}  // namespace

std::vector<std::string> pack_scene(const SceneOptions& options, const std::filesystem::path& file) {
  check_options(options);
  const Dataset dataset = read_dataset(options);
  require(!dataset.packed, options.source.string() + ": is packed already; copy it, or pack the original dataset");
  ImageOptions pictures = image_options(options);
  pictures.white_background = false;
  std::vector<LoadedView> loaded = load_photos(dataset.photos, pictures);
  std::vector<std::string> notes = dataset.notes;
  note_images(options, loaded, notes);

  std::vector<Photo> transparent;
  for (std::size_t i = 0; i < loaded.size(); ++i) {
    if (loaded[i].transparent) transparent.push_back(dataset.photos[i]);
  }
  pictures.white_background = true;
  std::vector<LoadedView> over_white = load_photos(transparent, pictures);

  PackedListing listing;
  auto next_over_white = over_white.begin();
  for (LoadedView& view : loaded) {
    PackedPhoto photo;
    photo.photo_width = view.photo_size.width;
    photo.photo_height = view.photo_size.height;
    photo.transparent = view.transparent;
    photo.masked = !view.view.valid.empty();
    if (photo.transparent) photo.color_over_white = std::move((next_over_white++)->view.color);
    photo.view = std::move(view.view);
    check_camera_position(photo.view, dataset.listing);
    listing.photos.push_back(std::move(photo));
  }
  listing.own_test = dataset.own_test.value_or(0);
  listing.has_test_split = dataset.own_test.has_value();
  listing.blender = dataset.blender;
  listing.images = dataset.images;
  listing.frames = dataset.frames;
  listing.points = dataset.points;
  listing.few_view_points = all_few_view_points(options.source);
  write_packed_scene(file, listing);
  return notes;
}

Scene read_scene(const SceneOptions& options) {
  check_options(options);
  Dataset dataset = read_dataset(options);
  PhotoSplit split = split_photos(options, dataset.names, dataset.own_test, dataset.listing);
  std::ranges::move(split.notes, std::back_inserter(dataset.notes));

  Scene scene;
  scene.white_background = options.white_background;
  scene.synthetic = dataset.blender;
  scene.notes = dataset.notes;
  if (const auto wanted = static_cast<std::size_t>(options.n_views); wanted > 0) {
    if (wanted > split.train.size()) {
      scene.notes.push_back("there are only " + std::to_string(split.train.size()) + " training views, not " +
                            std::to_string(wanted));
    }
    split.train = spread_evenly(split.train, wanted);
  }

  const std::size_t train_count = split.train.size();
  std::vector<std::size_t> chosen = std::move(split.train);
  std::ranges::copy(split.test, std::back_inserter(chosen));
  LoadedViews loaded = load_views(options, dataset, chosen, scene.notes);
  scene.cut_out = loaded.transparent;
  for (std::size_t i = 0; i < loaded.views.size(); ++i) {
    (i < train_count ? scene.train : scene.test).push_back(std::move(loaded.views[i]));
  }

  scene.extent = camera_extent(scene.train);
  if (!options.points) return scene;
  scene.points = std::move(dataset.points);
  scene.points_file = dataset.points_file;
  if (auto few = few_view_points(options, dataset)) {
    check_points(*few, dataset.packed ? dataset.listing : few_view_file(options.source, options.n_views));
    scene.points = std::move(*few);
    if (!dataset.packed) scene.points_file = few_view_file(options.source, options.n_views);
    scene.notes.push_back("training starts from the points of " +
                          few_view_file(options.source, options.n_views).string());
  }
  // Sizes of the first primitives are distances between points.
  if (scene.points.size() == 0 || all_at_one_place(scene.points.positions)) {
    scene.lacks_points = true;
    make_points(options, dataset, scene);
  }
  if (!(scene.extent > 0)) {
    // One camera, or all at one place: the extent of 3DGS, which scales the means' learning rate, would be 0.
    const float farthest = far_distance(scene.points, scene.train.front().camera.centre());
    scene.extent = farthest > 0 ? farthest : 1.0f;
    scene.notes.push_back(
        "all training cameras are at the same position; the size of the scene is computed from its points");
  }
  note_distance(scene);
  note_near_plane(scene);
  return scene;
}

}  // namespace splatboost
