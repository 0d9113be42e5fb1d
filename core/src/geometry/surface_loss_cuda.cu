// SPDX-License-Identifier: Apache-2.0
// One thread per pixel. Gradients that are divided by a count over the whole image are added in a later kernel than the
// one that counts.
#include <array>
#include <cmath>

#include "device/readbacks.h"
#include "geometry/cuda_ops.h"
#include "geometry/patch_math.h"
#include "geometry/pixels_cuda.h"

namespace splatboost::cuda {
namespace {

using surface::Pinhole;
using surface::Vector;
using surface::ViewPair;

__global__ void __launch_bounds__(kBlockThreads)
    edges_kernel(int width, int height, DeviceView<const std::uint8_t> color, DeviceView<const std::uint8_t> valid,
                 DeviceView<float> edges, DeviceView<std::uint32_t> range) {
  const ImagePixel pixel(width, height);
  bool inner = false;  // and without a masked neighbour: only these set the range
  float edge = 0;
  if (pixel.inside) {
    inner = pixel.x > 0 && pixel.y > 0 && pixel.x < width - 1 && pixel.y < height - 1 &&
            surface::has_data_around(valid, pixel.x, pixel.y, width);
    edges[pixel.index] = edge = surface::edge_of(color, pixel.x, pixel.y, width, height);
  }
  // Bits of floats that are not negative compare as integers; the minimum is kept as the maximum of the complements.
  const std::uint32_t greatest = warp_max(inner ? __float_as_uint(edge) : 0u);
  const std::uint32_t least = warp_max(inner ? ~__float_as_uint(edge) : 0u);
  if (threadIdx.x % 32 == 0) {
    atomicMax(&range[0], least);
    atomicMax(&range[1], greatest);
  }
}

__global__ void __launch_bounds__(kBlockThreads)
    normal_term_kernel(Pinhole<float> pinhole, bool by_edges, float share, DeviceView<const float> edges,
                       DeviceView<const std::uint32_t> range, DeviceView<const std::uint8_t> valid,
                       DeviceView<const float> depth, DeviceView<const float> alphas, DeviceView<const float> planes,
                       DeviceView<float> plane_gradients, DeviceView<float> differences, DeviceView<double> sums) {
  const ImagePixel pixel(pinhole.width, pinhole.height);
  const std::size_t p = pixel.index, pixels = pixel.pixels;
  float sum = 0;
  if (pixel.inside) {
    const bool border = pixel.x == 0 || pixel.y == 0 || pixel.x == pinhole.width - 1 || pixel.y == pinhole.height - 1;
    float weight = 1;
    if (by_edges) {
      const float least = __uint_as_float(~range[0]), span = __uint_as_float(range[1]) - least;
      weight = border ? 0.0f : surface::edge_weight(span > 0 ? (edges[p] - least) / span : 0.0f);
    }
    if (!valid.empty() && valid[p] == 0) weight = 0;
    float g[6] = {0, 0, 0, 0, 0, 0};
    if (weight > 0) {
      const surface::Cross<float> at = surface::normal_of_depth(pinhole, depth, pixel.x, pixel.y);
      const float alpha = alphas[p];
      const float from_depth[3] = {at.normal.x, at.normal.y, at.normal.z};
      float signs[3];
      for (std::size_t c = 0; c < 3; ++c) {
        const float difference = alpha * from_depth[c] - planes[c * pixels + p];
        sum += weight * fabsf(difference);
        signs[c] = difference > 0 ? weight * share : difference < 0 ? -weight * share : 0.0f;
        plane_gradients[c * pixels + p] -= signs[c];
      }
      Vector<float> g_right_left, g_top_bottom;
      surface::cross_backward(at, {alpha * signs[0], alpha * signs[1], alpha * signs[2]}, g_right_left, g_top_bottom);
      g[0] = g_right_left.x, g[1] = g_right_left.y, g[2] = g_right_left.z;
      g[3] = g_top_bottom.x, g[4] = g_top_bottom.y, g[5] = g_top_bottom.z;
    }
    for (std::size_t c = 0; c < 6; ++c) differences[c * pixels + p] = g[c];
  }
  add_to_sum(sums, kNormalSum, sum);
}

__global__ void __launch_bounds__(kBlockThreads)
    gather_differences_kernel(Pinhole<float> pinhole, DeviceView<const float> differences,
                              DeviceView<float> depth_gradients) {
  const ImagePixel pixel(pinhole.width, pinhole.height);
  if (!pixel.inside) return;
  depth_gradients[pixel.index] +=
      dot(pixel.ray(pinhole), surface::gather_differences(pinhole, differences, pixel.x, pixel.y));
}

__global__ void __launch_bounds__(kBlockThreads)
    greys_kernel(DeviceView<const std::uint8_t> color, DeviceView<const std::uint8_t> valid, DeviceView<float> greys) {
  const std::size_t p = element_index();
  if (p < greys.size()) greys[p] = surface::grey_of(color, valid, p, greys.size());
}

__global__ void __launch_bounds__(kBlockThreads)
    match_kernel(ViewPair<float> views, SurfaceTerms terms, DeviceView<const std::uint8_t> valid_first,
                 DeviceView<const std::uint8_t> valid_second, DeviceView<const float> depth_first,
                 DeviceView<const float> depth_second, DeviceView<PixelMatch> matches, DeviceView<double> sums) {
  const ImagePixel pixel(views.first.width, views.first.height);
  float noise = 0, agrees = 0;
  if (pixel.inside) {
    const PixelMatch match = surface::match_pixel(views, pixel.x, pixel.y, depth_first[pixel.index], depth_second,
                                                  valid_first, valid_second, terms);
    matches[pixel.index] = match;
    if (match.noise >= 0) {
      noise = expf(-match.noise) * match.noise;
      agrees = 1;
    }
  }
  add_to_sum(sums, kNoiseSum, noise);
  add_to_sum(sums, kNoiseCount, agrees);
}

__global__ void __launch_bounds__(kBlockThreads)
    geometric_gradient_kernel(int width, int height, float weight, DeviceView<const PixelMatch> matches,
                              DeviceView<const double> sums, DeviceView<float> g_first, DeviceView<float> g_second) {
  const std::size_t p = element_index();
  if (p >= matches.size()) return;
  const PixelMatch match = matches[p];
  if (!(match.noise > 0)) return;
  const float g = weight / static_cast<float>(sums[kNoiseCount]) * expf(-match.noise);
  g_first[p] += g * match.g_first;
  const surface::Bilinear<float> at(match.x, match.y, width, height);
  float weights[4];
  at.weights(weights);
  atomicAdd(&g_second[at.index(at.x0, at.y0, width)], g * match.g_second * weights[0]);
  atomicAdd(&g_second[at.index(at.x1, at.y0, width)], g * match.g_second * weights[1]);
  atomicAdd(&g_second[at.index(at.x0, at.y1, width)], g * match.g_second * weights[2]);
  atomicAdd(&g_second[at.index(at.x1, at.y1, width)], g * match.g_second * weights[3]);
}

struct Texels {
  DeviceView<const float> image;
  int width;
  __device__ float operator()(float column, float row) const {
    return image[static_cast<std::size_t>(row) * static_cast<std::size_t>(width) + static_cast<std::size_t>(column)];
  }
};

__global__ void __launch_bounds__(kBlockThreads)
    patch_kernel(PatchViews views, int max_patches, RandomStream random, DeviceView<const PixelMatch> matches,
                 DeviceView<const float> planes, DeviceView<const float> greys_first,
                 DeviceView<const float> greys_second, DeviceView<PatchGradient> patches, DeviceView<double> sums) {
  const ImagePixel pixel(views.width, views.height);
  float loss = 0, counts = 0;
  if (pixel.inside) {
    PatchGradient gradient{};
    const float noise = matches[pixel.index].noise;
    if (noise >= 0 && random.uniform(pixel.index) < max_patches / sums[kNoiseCount]) {
      const surface::Plane<float> plane = pixel.plane(planes);
      const float normal[3] = {plane.normal.x, plane.normal.y, plane.normal.z};
      const PatchMatch<float> match =
          match_patch(views, place_in_photo(pixel.x, views.per_x), place_in_photo(pixel.y, views.per_y), normal,
                      plane.distance, Texels{greys_first, views.width_first}, Texels{greys_second, views.width_second});
      if (match.counts > 0) {
        const float weight = expf(-noise);
        loss = weight * match.loss;
        counts = 1;
        gradient = {{weight * match.normal[0], weight * match.normal[1], weight * match.normal[2]},
                    weight * match.distance};
      }
    }
    patches[pixel.index] = gradient;
  }
  add_to_sum(sums, kPatchSum, loss);
  add_to_sum(sums, kPatchCount, counts);
}

__global__ void __launch_bounds__(kBlockThreads)
    patch_gradient_kernel(float weight, DeviceView<const PatchGradient> patches, DeviceView<const double> sums,
                          DeviceView<float> plane_gradients) {
  const std::size_t p = element_index(), pixels = patches.size();
  if (p >= pixels || sums[kPatchCount] == 0) return;
  const PatchGradient gradient = patches[p];
  const float share = weight / static_cast<float>(sums[kPatchCount]);
  for (std::size_t c = 0; c < 3; ++c) plane_gradients[c * pixels + p] += share * gradient.normal[c];
  plane_gradients[3 * pixels + p] += share * gradient.distance;
}

template <class T>
std::span<const T> read(const Array<T>& array) {
  return array.span();
}

}  // namespace

void add_normal_term(const SurfaceView& first, const SurfaceTerms& terms, SurfaceWorkspace& work, CudaStream& stream) {
  const int width = first.camera.width, height = first.camera.height;
  const std::size_t pixels = first.alpha.size();
  const bool by_edges = terms.edge_aware && !first.truth.color.empty();
  work.edge_range.assign_zeros(2);
  work.edges.ensure(by_edges ? pixels : 0);
  if (by_edges) {
    launch_each(stream, "edges", edges_kernel, pixels, width, height, first.truth.color, first.truth.valid,
                work.edges.span(), work.edge_range.span());
  }
  work.differences.ensure(6 * pixels);
  const auto pinhole = surface::pinhole_of<float>(first.camera);
  launch_each(stream, "normal_term", normal_term_kernel, pixels, pinhole, by_edges,
              terms.normal_weight / static_cast<float>(pixels), read(work.edges), read(work.edge_range),
              first.truth.valid, read(work.depth[0]), first.alpha, first.planes, first.plane_gradients,
              work.differences.span(), work.sums.span());
  launch_each(stream, "gather_differences", gather_differences_kernel, pixels, pinhole, read(work.differences),
              work.depth_gradients[0].span());
}

void add_two_view_terms(const SurfaceView& first, const SurfaceView& second, const SurfaceTerms& terms,
                        const RandomStream& random, SurfaceWorkspace& work, CudaStream& stream) {
  const std::size_t pixels = work.depth[0].size();
  const ViewPair<float> views = surface::pair_of<float>(first.camera, second.camera);
  work.matches.ensure(pixels);
  launch_each(stream, "match", match_kernel, pixels, views, terms, first.truth.valid, second.truth.valid,
              read(work.depth[0]), read(work.depth[1]), work.matches.span(), work.sums.span());
  const std::span<const PixelMatch> matches = read(work.matches);
  const std::span<const double> sums = read(work.sums);
  if (terms.geometric_weight > 0) {
    launch_each(stream, "geometric_gradient", geometric_gradient_kernel, pixels, second.camera.width,
                second.camera.height, terms.geometric_weight, matches, sums, work.depth_gradients[0].span(),
                work.depth_gradients[1].span());
  }
  if (terms.photometric_weight == 0 || second.truth.color.empty() || first.truth.color.empty()) return;
  const PatchPhoto photos[2] = {patch_photo(first), patch_photo(second)};
  for (std::size_t v = 0; v < 2; ++v) {
    const TruthImage& truth = photos[v].truth;
    work.greys[v].ensure(truth.color.size() / 3);
    launch_each(stream, "greys", greys_kernel, work.greys[v].size(), truth.color, truth.valid, work.greys[v].span());
  }
  work.patches.ensure(pixels);
  const PatchViews patch_pair =
      patch_views(surface::pair_of<float>(photos[0].camera, photos[1].camera), first.camera.width, first.camera.height);
  launch_each(stream, "patches", patch_kernel, pixels, patch_pair, terms.max_patches, random, matches, first.planes,
              read(work.greys[0]), read(work.greys[1]), work.patches.span(), work.sums.span());
  launch_each(stream, "patch_gradient", patch_gradient_kernel, pixels, terms.photometric_weight, read(work.patches),
              sums, first.plane_gradients);
}

struct PendingSurfaceLoss::State {
  using Sums = std::array<double, kSurfaceSums>;
  static constexpr std::size_t kCapacity = 64;
  struct Call {
    SurfaceTerms terms;
    std::size_t pixels = 0;
  };
  explicit State(CudaStream& stream) : sums(stream) {}

  void note(const Sums& arrived) {
    const Call& call = calls[taken++ % kCapacity];
    const SurfaceLossParts parts = surface_loss_parts(arrived.data(), call.terms, call.pixels);
    if (std::isfinite(newest.total())) newest = parts;
  }

  Readbacks<Sums, kCapacity> sums;
  std::array<Call, kCapacity> calls;
  std::size_t sent = 0, taken = 0;
  SurfaceLossParts newest;
};

PendingSurfaceLoss::PendingSurfaceLoss(CudaStream& stream) : state_(std::make_unique<State>(stream)) {}
PendingSurfaceLoss::~PendingSurfaceLoss() = default;

void PendingSurfaceLoss::send(const SurfaceWorkspace& workspace, const SurfaceTerms& terms, std::size_t pixels) {
  State& state = *state_;
  if (state.sums.is_full()) state.note(state.sums.wait());
  state.sums.send(workspace.sums.span().data());
  state.calls[state.sent++ % State::kCapacity] = {terms, pixels};
}

SurfaceLossParts PendingSurfaceLoss::newest() {
  while (const auto arrived = state_->sums.take()) state_->note(*arrived);
  return state_->newest;
}

}  // namespace splatboost::cuda
