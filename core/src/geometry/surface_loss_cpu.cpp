// SPDX-License-Identifier: Apache-2.0
#include "splatboost/surface_loss.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "geometry/cuda_ops.h"
#include "geometry/patch_views.h"
#include "geometry/surface_math.h"
#include "geometry/surface_workspace.h"
#include "splatboost/errors.h"
#include "splatboost/gaussian_planes.h"
#include "splatboost/surface_depth.h"

namespace splatboost {
namespace {

using surface::Vector;

constexpr std::size_t kGrain = 4096;
constexpr std::size_t kRowGrain = 4;
/// Sums per row, added up in the order of the rows, whichever threads computed them.
using RowSums = std::vector<std::array<double, 2>>;

std::size_t pixels_of(const Camera& camera) {
  return static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
}

/// Calls body(x, y, pixel) for all pixels, row by row; the rows are divided among the threads.
template <class Body>
void for_pixels(const Camera& camera, const Threads& threads, const Body& body) {
  const auto width = static_cast<std::size_t>(camera.width);
  threads.for_range(static_cast<std::size_t>(camera.height), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t y = begin; y < end; ++y) {
      for (std::size_t x = 0; x < width; ++x) body(static_cast<int>(x), static_cast<int>(y), y * width + x);
    }
  });
}

std::array<double, 2> total_of(const RowSums& rows) {
  std::array<double, 2> total{};
  for (const auto& row : rows) {
    total[0] += row[0];
    total[1] += row[1];
  }
  return total;
}

void fill_edges(const SurfaceView& view, SurfaceWorkspace& work, const Threads& threads) {
  const int width = view.camera.width, height = view.camera.height;
  work.edges.ensure(pixels_of(view.camera));
  const std::span<float> edges = work.edges;
  for_pixels(view.camera, threads,
             [&](int x, int y, std::size_t p) { edges[p] = surface::edge_of(view.truth.color, x, y, width, height); });
  float least = 765, greatest = 0;
  for (int y = 1; y + 1 < height; ++y) {
    const float* row = &edges[static_cast<std::size_t>(y) * static_cast<std::size_t>(width)];
    for (int x = 1; x + 1 < width; ++x) {
      if (!surface::has_data_around(view.truth.valid, x, y, width)) continue;
      least = std::min(least, row[x]);
      greatest = std::max(greatest, row[x]);
    }
  }
  const float range = greatest - least;
  for (float& edge : edges) edge = range > 0 ? (edge - least) / range : 0.0f;
}

void add_normal_term(const SurfaceView& first, const SurfaceTerms& terms, SurfaceWorkspace& work,
                     const Threads& threads) {
  const std::size_t pixels = pixels_of(first.camera);
  const auto pinhole = surface::pinhole_of<float>(first.camera);
  const bool by_edges = terms.edge_aware && !first.truth.color.empty();
  if (by_edges) fill_edges(first, work, threads);
  work.differences.assign_zeros(6 * pixels);
  const std::span<const float> depth = std::as_const(work.depth[0]), edges = std::as_const(work.edges);
  const std::span<float> differences = work.differences, depth_gradients = work.depth_gradients[0];
  const float share = terms.normal_weight / static_cast<float>(pixels);
  RowSums rows(static_cast<std::size_t>(first.camera.height));
  for_pixels(first.camera, threads, [&](int x, int y, std::size_t p) {
    if (!first.truth.valid.empty() && first.truth.valid[p] == 0) return;
    const bool border = x == 0 || y == 0 || x == pinhole.width - 1 || y == pinhole.height - 1;
    const float weight = !by_edges ? 1.0f : border ? 0.0f : surface::edge_weight(edges[p]);
    if (weight == 0) return;
    const surface::Cross<float> at = surface::normal_of_depth(pinhole, depth, x, y);
    const float alpha = first.alpha[p];
    const float from_depth[3] = {at.normal.x, at.normal.y, at.normal.z};
    float signs[3];
    double sum = 0;
    for (std::size_t c = 0; c < 3; ++c) {
      const float difference = alpha * from_depth[c] - first.planes[c * pixels + p];
      sum += static_cast<double>(weight * std::abs(difference));
      signs[c] = difference > 0 ? weight * share : difference < 0 ? -weight * share : 0.0f;
      first.plane_gradients[c * pixels + p] -= signs[c];
    }
    rows[static_cast<std::size_t>(y)][0] += sum;
    Vector<float> g_right_left, g_top_bottom;
    surface::cross_backward(at, {alpha * signs[0], alpha * signs[1], alpha * signs[2]}, g_right_left, g_top_bottom);
    const float g[6] = {g_right_left.x, g_right_left.y, g_right_left.z, g_top_bottom.x, g_top_bottom.y, g_top_bottom.z};
    for (std::size_t c = 0; c < 6; ++c) differences[c * pixels + p] = g[c];
  });
  work.sums.host()[kNormalSum] = total_of(rows)[0];

  // Each depth takes part in the normals of its four neighbours.
  for_pixels(first.camera, threads, [&](int x, int y, std::size_t p) {
    const Vector<float> g = surface::gather_differences(pinhole, differences, x, y);
    depth_gradients[p] += dot(pinhole.ray(static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f), g);
  });
}

void fill_greys(const TruthImage& truth, Array<float>& greys, const Threads& threads) {
  const std::size_t pixels = truth.color.size() / 3;
  greys.ensure(pixels);
  const std::span<float> out = greys;
  threads.for_range(pixels, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t p = begin; p < end; ++p) out[p] = surface::grey_of(truth.color, truth.valid, p, pixels);
  });
}

void add_two_view_terms(const SurfaceView& first, const SurfaceView& second, const SurfaceTerms& terms,
                        const RandomStream& random, SurfaceWorkspace& work, const Threads& threads) {
  const std::size_t pixels = pixels_of(first.camera);
  const surface::ViewPair<float> views = surface::pair_of<float>(first.camera, second.camera);
  const std::span<const float> depth_first = std::as_const(work.depth[0]), depth_second = std::as_const(work.depth[1]);
  work.matches.ensure(pixels);
  const std::span<PixelMatch> matches = work.matches;
  RowSums rows(static_cast<std::size_t>(first.camera.height));
  for_pixels(first.camera, threads, [&](int x, int y, std::size_t p) {
    matches[p] =
        surface::match_pixel(views, x, y, depth_first[p], depth_second, first.truth.valid, second.truth.valid, terms);
    if (matches[p].noise < 0) return;
    auto& row = rows[static_cast<std::size_t>(y)];
    row[0] += static_cast<double>(std::exp(-matches[p].noise) * matches[p].noise);
    row[1] += 1;
  });
  const auto [noise, agreeing] = total_of(rows);
  work.sums.host()[kNoiseSum] = noise;
  work.sums.host()[kNoiseCount] = agreeing;
  if (agreeing == 0) return;

  if (terms.geometric_weight > 0) {
    const float share = terms.geometric_weight / static_cast<float>(agreeing);
    const std::span<float> g_first = work.depth_gradients[0], g_second = work.depth_gradients[1];
    const int width = second.camera.width, height = second.camera.height;
    // Serial, in the order of the pixels: several may add to the same texel.
    for (std::size_t p = 0; p < pixels; ++p) {
      const PixelMatch& match = matches[p];
      if (!(match.noise > 0)) continue;
      const float g = share * std::exp(-match.noise);
      g_first[p] += g * match.g_first;
      const surface::Bilinear<float> at(match.x, match.y, width, height);
      float weights[4];
      at.weights(weights);
      g_second[at.index(at.x0, at.y0, width)] += g * match.g_second * weights[0];
      g_second[at.index(at.x1, at.y0, width)] += g * match.g_second * weights[1];
      g_second[at.index(at.x0, at.y1, width)] += g * match.g_second * weights[2];
      g_second[at.index(at.x1, at.y1, width)] += g * match.g_second * weights[3];
    }
  }

  if (terms.photometric_weight == 0 || second.truth.color.empty() || first.truth.color.empty()) return;
  const PatchPhoto photo = patch_photo(first), other_photo = patch_photo(second);
  fill_greys(photo.truth, work.greys[0], threads);
  fill_greys(other_photo.truth, work.greys[1], threads);
  const std::span<const float> greys_first = std::as_const(work.greys[0]), greys_second = std::as_const(work.greys[1]);
  work.patches.ensure(pixels);
  const std::span<PatchGradient> patches = work.patches;
  const double drawn = static_cast<double>(terms.max_patches) / agreeing;
  rows.assign(rows.size(), {});
  const PatchViews patch_pair =
      patch_views(surface::pair_of<float>(photo.camera, other_photo.camera), first.camera.width, first.camera.height);
  const auto width = static_cast<std::size_t>(first.camera.width);
  threads.for_range(rows.size(), kRowGrain, [&](std::size_t begin, std::size_t end) {
    std::vector<std::int32_t> columns;
    std::vector<float> losses(width), counts(width);
    std::vector<PatchGradient> gradients(width);
    for (std::size_t y = begin; y < end; ++y) {
      columns.clear();
      for (std::size_t x = 0; x < width; ++x) {
        const std::size_t p = y * width + x;
        patches[p] = {};
        if (matches[p].noise >= 0 && random.uniform(p) < drawn) columns.push_back(static_cast<std::int32_t>(x));
      }
      match_patches(patch_pair, static_cast<int>(y), columns, first.planes, greys_first, greys_second, losses, counts,
                    gradients);
      for (std::size_t i = 0; i < columns.size(); ++i) {
        if (!(counts[i] > 0)) continue;
        const std::size_t p = y * width + static_cast<std::size_t>(columns[i]);
        const float weight = std::exp(-matches[p].noise);
        rows[y][0] += static_cast<double>(weight * losses[i]);
        rows[y][1] += 1;
        for (std::size_t c = 0; c < 3; ++c) patches[p].normal[c] = weight * gradients[i].normal[c];
        patches[p].distance = weight * gradients[i].distance;
      }
    }
  });
  const auto [loss, counted] = total_of(rows);
  work.sums.host()[kPatchSum] = loss;
  work.sums.host()[kPatchCount] = counted;
  if (counted == 0) return;
  const float share = terms.photometric_weight / static_cast<float>(counted);
  threads.for_range(pixels, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t p = begin; p < end; ++p) {
      for (std::size_t c = 0; c < 3; ++c) first.plane_gradients[c * pixels + p] += share * patches[p].normal[c];
      first.plane_gradients[3 * pixels + p] += share * patches[p].distance;
    }
  });
}

void check_surface_view(const SurfaceView& view, bool with_alpha) {
  check_camera(view.camera);
  const std::size_t pixels = pixels_of(view.camera);
  SPLATBOOST_CHECK(view.planes.size() == kPlaneChannels * pixels && view.plane_gradients.size() == view.planes.size(),
                   "planes and their gradients must be [4,H,W]");
  SPLATBOOST_CHECK(!with_alpha || view.alpha.size() == pixels, "alpha must be [H,W]");
  SPLATBOOST_CHECK(view.truth.color.empty() || view.truth.color.size() == 3 * pixels,
                   "the photo must be empty or of the camera's size");
  SPLATBOOST_CHECK(view.truth.valid.empty() || view.truth.valid.size() == pixels,
                   "the photo's mask must be empty or of the camera's size");
  if (view.patches == nullptr) return;
  check_camera(view.patches->camera);
  SPLATBOOST_CHECK(view.patches->truth.color.size() == 3 * pixels_of(view.patches->camera),
                   "the photo of patches must be of its camera's size");
  SPLATBOOST_CHECK(
      view.patches->truth.valid.empty() || view.patches->truth.valid.size() == pixels_of(view.patches->camera),
      "the mask of the photo of patches must be empty or of its camera's size");
}

}  // namespace

struct SurfaceLoss::State {
  explicit State(Device d) : device(d), work(d) {
    if (device.is_cuda()) pending.emplace(device.stream());
  }
  Device device;
  SurfaceWorkspace work;
  std::optional<cuda::PendingSurfaceLoss> pending;  ///< only on a GPU
};

SurfaceLoss::SurfaceLoss(Device device) : state_(std::make_unique<State>(device)) {}
SurfaceLoss::~SurfaceLoss() = default;
std::size_t SurfaceLoss::bytes_per_pixel() { return kSurfaceBytesPerPixel; }
SurfaceLoss::SurfaceLoss(SurfaceLoss&&) noexcept = default;
SurfaceLoss& SurfaceLoss::operator=(SurfaceLoss&&) noexcept = default;

SurfaceLossParts SurfaceLoss::add(const SurfaceView& first, const SurfaceView* second, const SurfaceTerms& terms,
                                  const RandomStream& random) {
  check_surface_view(first, true);
  if (second != nullptr) check_surface_view(*second, false);
  SPLATBOOST_CHECK(terms.normal_weight >= 0 && terms.geometric_weight >= 0 && terms.photometric_weight >= 0 &&
                       terms.max_pixel_noise > 0 && terms.max_patches >= 0 && terms.near_depth >= 0,
                   "weights and limits must not be negative");
  SurfaceWorkspace& work = state_->work;
  const Device device = state_->device;
  const SurfaceView* views[2] = {&first, second};
  work.sums.assign_zeros(kSurfaceSums);
  for (std::size_t v = 0; v < 2 && views[v] != nullptr; ++v) {
    const std::size_t pixels = pixels_of(views[v]->camera);
    work.depth[v].ensure(pixels);
    work.depth_gradients[v].assign_zeros(pixels);
    plane_depth(views[v]->camera, views[v]->planes, work.depth[v], device);
  }
  if (terms.normal_weight > 0) {
    device.is_cuda() ? cuda::add_normal_term(first, terms, work, device.stream())
                     : add_normal_term(first, terms, work, device.threads());
  }
  if (second != nullptr) {
    device.is_cuda() ? cuda::add_two_view_terms(first, *second, terms, random, work, device.stream())
                     : add_two_view_terms(first, *second, terms, random, work, device.threads());
  }
  for (std::size_t v = 0; v < 2 && views[v] != nullptr; ++v) {
    plane_depth_backward(views[v]->camera, views[v]->planes, work.depth_gradients[v], views[v]->plane_gradients,
                         device);
  }
  if (!device.is_cuda()) return surface_loss_parts(work.sums.host().data(), terms, pixels_of(first.camera));
  state_->pending->send(work, terms, pixels_of(first.camera));
  return state_->pending->newest();
}

}  // namespace splatboost
